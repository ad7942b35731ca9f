# SPDX-License-Identifier: MIT
"""Simulator, recorded logs, views and the command line: what wires the estimator (`slam`) to data and measures."""
