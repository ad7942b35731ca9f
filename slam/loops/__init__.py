# SPDX-License-Identifier: MIT
"""Loops that the filter left open: places that are seen again, found and closed after the run."""

from slam.loops.close_loops import LoopClosing, close_loops
from slam.loops.loop import Loop
from slam.loops.pose_graph import Edges

__all__ = ["Edges", "Loop", "LoopClosing", "close_loops"]
