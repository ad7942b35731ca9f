# SPDX-License-Identifier: MIT
"""Frames of a recording and a true trajectory of the same clock, put together."""

from __future__ import annotations

from dataclasses import replace

from eval.trajectory.association import associate
from eval.trajectory.trajectory import Trajectory
from testbed.frame_table import FrameTable


def attach_truth(table: FrameTable, truth: Trajectory) -> FrameTable:
    """The frames with the truth of their stamps, where there is one; ValueError where there is none at all."""
    found = associate(Trajectory(table.stamps, table.odometry), truth)
    poses = table.truth.copy()
    poses[found.rows] = found.reference.poses
    return replace(table, truth=poses)
