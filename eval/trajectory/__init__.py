# SPDX-License-Identifier: MIT
"""Measures of trajectories against ground truth or hand-checked relations."""
