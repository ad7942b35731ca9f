# SPDX-License-Identifier: MIT
"""Frames of a recording and a true trajectory of the same clock, put together."""

from __future__ import annotations

from dataclasses import replace

from eval.trajectory.association import associate
from eval.trajectory.trajectory import Trajectory
from testbed.frame_table import FrameTable


def attach_truth(table: FrameTable, truth: Trajectory) -> FrameTable:
    """The table with the truth at the stamps of its frames, where there is one; ValueError where it has none."""
    found = associate(Trajectory(table.stamps, table.odometry), truth)
    poses = table.truth.copy()
    poses[found.rows] = found.reference.poses
    return replace(table, truth=poses)
