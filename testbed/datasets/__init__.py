# SPDX-License-Identifier: MIT
"""Synthetic datasets: written by the simulator, each with its truth."""
