# SPDX-License-Identifier: MIT
"""Loops that the filter left open: places that are seen again, found and closed after the run."""

from slam.loops.close_loops import LoopClosing, close_loops
from slam.loops.find_loops import Loop

__all__ = ["Loop", "LoopClosing", "close_loops"]
