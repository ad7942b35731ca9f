# SPDX-License-Identifier: MIT
"""Likelihood of a scan, scan matching and the improved proposal (T-RO 2007, Algorithm 1, lines 4 to 21)."""
