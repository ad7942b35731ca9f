# SPDX-License-Identifier: MIT
"""Grid maps of all particles: counts, sub-cell surface and nearest-wall field, in shared tiles."""
