# SPDX-License-Identifier: MIT
"""Planning on the map so far: floor, frontiers, goals, shortest paths."""
