# SPDX-License-Identifier: MIT
"""Frames of a recording and a true trajectory of the same clock, put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eval.trajectory.association import associate
from eval.trajectory.trajectory import Trajectory
from testbed.frame import Frame


def attach_truth(frames: Sequence[Frame], truth: Trajectory) -> list[Frame]:
    """The frames with the truth of their stamps, where there is one; ValueError where there is none at all."""
    at = Trajectory(np.array([frame.stamp for frame in frames]), np.array([frame.odometry for frame in frames]))
    found = associate(at, truth)
    complete = list(frames)
    for row, pose in zip(found.rows.tolist(), found.reference.poses, strict=True):
        complete[row] = replace(frames[row], truth=pose)
    return complete
