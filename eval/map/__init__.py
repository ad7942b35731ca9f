# SPDX-License-Identifier: MIT
"""Measures of occupancy grids against the true map."""
