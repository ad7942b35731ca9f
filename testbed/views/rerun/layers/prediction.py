# SPDX-License-Identifier: MIT
"""What the odometry predicts at an update, and how far what the scans say lies from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config import MotionConfig
from slam.motion.odometry_model import motion_prior
from slam.se2 import Pose
from testbed.views.view import Snapshot

MAX_SIGMAS = 5.0
"""Odometry disagrees with the scans beyond this many standard deviations of the motion model …"""
MIN_MISS_M, MIN_MISS_DEG = 0.08, 4.0
"""… and beyond either of these: what nobody would see is not worth a line."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """The best particle's pose as the motion model predicts it, in the map's frame."""

    pose: Pose
    """Mean, (3,)."""
    covariance: NDArray[np.float64]
    """Covariance, (3, 3)."""
    by_wheels: Pose
    """Motion since the last update by the odometry, (3,)."""
    by_scans: Pose
    """Motion since then as the filter has it, (3,)."""

    @property
    def disagreement(self) -> str | None:
        """A sentence with both motions where they do not agree."""
        miss = se2.between(self.by_wheels, self.by_scans)
        metres, degrees = float(np.hypot(miss[0], miss[1])), abs(float(np.degrees(miss[2])))
        sigma_m, sigma_deg = (
            np.sqrt(self.covariance[0, 0] + self.covariance[1, 1]),
            np.degrees(np.sqrt(self.covariance[2, 2])),
        )
        far = metres > max(MIN_MISS_M, MAX_SIGMAS * sigma_m)
        if not far and degrees <= max(MIN_MISS_DEG, MAX_SIGMAS * sigma_deg):
            return None
        wheels, scans = _in_words(self.by_wheels), _in_words(self.by_scans)
        return f"odometry disagrees with the scans: the wheels report {wheels}, the scans {scans}"


def predict(before: Snapshot, now: Snapshot, motion: MotionConfig) -> Prediction | None:
    """Predict the pose at an update from the update before it; None where the particle's past is unknown."""
    step, poses = now.step, before.poses
    if step is None or poses is None or step.best >= len(poses):
        return None
    by_wheels, start = se2.between(before.odometry, now.odometry), poses[step.best]
    predicted = se2.compose(start, by_wheels)
    along, across, turn = 1.0 / motion_prior(by_wheels, motion).precision[0]
    cos, sin = np.cos(start[2] + by_wheels[2]), np.sin(start[2] + by_wheels[2])
    axes = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    covariance = axes @ np.diag([along, across, turn]) @ axes.T
    return Prediction(predicted, covariance, by_wheels, se2.between(start, step.pose))


def _in_words(motion: Pose) -> str:
    return f"{np.hypot(motion[0], motion[1]):.2f} m and {np.degrees(motion[2]):.0f} degrees"
