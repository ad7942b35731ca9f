# SPDX-License-Identifier: MIT
"""Computes the cells of a sweep: in this process, in worker processes, on a cluster."""
