# SPDX-License-Identifier: MIT
"""Odometry that goes on where it starts again: a restarted driver, or an encoder that jumps, moves no robot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam.sensor.possible_motion import MAX_SPEED, MAX_TURN_RATE

MIN_JUMP, MIN_TURN = 0.3, math.radians(30.0)
"""Smaller steps [m], [rad] are no jump, however short the time between two of them is."""


def has_jumped(steps: se2.Pose, seconds: ArrayLike) -> NDArray[np.bool_]:
    """Whether displacements (..., 3) [m, m, rad] within so many seconds (...) are more than any robot can do.

    Nothing is known of displacements within no time, as of scans without stamps.
    """
    length, turn = np.hypot(steps[..., 0], steps[..., 1]), np.abs(steps[..., 2])
    spans = np.asarray(seconds, dtype=np.float64)
    far = (length > np.maximum(MAX_SPEED * spans, MIN_JUMP)) | (turn > np.maximum(MAX_TURN_RATE * spans, MIN_TURN))
    jumped: NDArray[np.bool_] = far & (spans > 0.0)
    return jumped


class ContinuousOdometry:
    """Joins odometry that comes pose by pose: after a jump it goes on from where it was.

    The robot is taken to have stood still during the jump; the motion model's third component covers what it did.
    """

    def __init__(self) -> None:
        self.jumps = 0
        """Number of jumps so far."""
        self._stamp = 0.0
        self._raw: se2.Pose | None = None
        self._joined = np.zeros(3)
        self._T_joined_raw: se2.Pose | None = None  # None: no jump so far, and poses pass as they are, bit by bit

    def update(self, stamp: float, pose: se2.Pose) -> se2.Pose:
        """The joined odometry (3,) for the odometry `pose` (3,) at a time [s]."""
        if self._raw is not None and has_jumped(se2.between(self._raw, pose), stamp - self._stamp):
            self._T_joined_raw = se2.compose(self._joined, se2.inverse(pose))
            self.jumps += 1
        self._stamp, self._raw = stamp, pose
        self._joined = pose if self._T_joined_raw is None else se2.compose(self._T_joined_raw, pose)
        return self._joined

    def state(self) -> dict[str, Any]:
        """Everything remembered, as plain values."""
        poses = (self._raw, self._joined, self._T_joined_raw)
        return {
            "stamp": self._stamp,
            "jumps": self.jumps,
            "poses": [None if pose is None else pose.tolist() for pose in poses],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._stamp, self.jumps = state["stamp"], state["jumps"]
        raw, joined, T = (None if pose is None else np.array(pose) for pose in state["poses"])
        self._raw, self._T_joined_raw = raw, T
        self._joined = np.zeros(3) if joined is None else joined


def join_odometry(stamps: NDArray[np.float64], poses: se2.Pose) -> se2.Pose:
    """The joined odometry (n, 3) of a recording; stamps (n,) [s], poses (n, 3)."""
    track = ContinuousOdometry()
    return np.array([track.update(float(stamp), pose) for stamp, pose in zip(stamps, poses, strict=True)])
