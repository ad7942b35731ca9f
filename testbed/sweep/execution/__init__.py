# SPDX-License-Identifier: MIT
"""Computing the cells of a sweep: here, in worker processes, on a cluster."""
