# SPDX-License-Identifier: MIT
"""Measures of the particle filter itself: its health over a run, and whether its covariance is honest."""
