# SPDX-License-Identifier: MIT
"""CARMEN logs in and out."""
