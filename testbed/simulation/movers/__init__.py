# SPDX-License-Identifier: MIT
"""People and doors that move."""
