# SPDX-License-Identifier: MIT
"""Worlds that are generated: rooms, mazes, caves, clutter, tours."""
