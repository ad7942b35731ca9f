# SPDX-License-Identifier: MIT
"""The motion model p(x | x', u)."""
