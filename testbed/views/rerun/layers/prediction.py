# SPDX-License-Identifier: MIT
"""What the odometry predicts at an update, and how far what the scans say lies from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config import MotionConfig
from slam.motion.odometry_model import motion_prior
from slam.se2 import Pose
from testbed.views.rerun.layers.repeats import Repeats
from testbed.views.view import Snapshot

MAX_SIGMAS = 5.0
"""Odometry disagrees with the scans beyond this many standard deviations of the motion model …"""
QUIET_S = 20.0
"""One fault makes several updates disagree, and wheels slip again and again: after a sentence there is none for this
long [s], unless they are more than twice as far apart."""
Time = tuple[float, int]
"""Time [s] since the first scan, and number of the scan."""
MIN_MISS_M, MIN_MISS_DEG = 0.08, 4.0
"""… and beyond either of these: what nobody would see is not worth a line."""


class Prediction(NamedTuple):
    """The best particle's pose as the motion model predicts it at an update, in the map's frame."""

    time: Time
    """Time of the update, see `Columns.time`."""
    pose: Pose
    """Mean, (3,)."""
    covariance: NDArray[np.float64]
    """Covariance, (3, 3)."""
    disagreement: str | None
    """A sentence with the motions by odometry and by scans where they do not agree."""


class Predictions:
    """What the odometry predicts at the updates; they are worked out many at a time."""

    def __init__(self, motion: MotionConfig) -> None:
        """No update has come yet."""
        self._motion = motion
        self._repeats = Repeats(QUIET_S)
        self._times: list[Time] = []
        self._rows: list[tuple[Pose, Pose, Pose, Pose]] = []  # odometry before and now, best particle before and now

    def add(self, time: Time, before: Snapshot, now: Snapshot) -> None:
        """Note an update and the one before it; nothing where the best particle's past is unknown."""
        step, poses = now.step, before.poses
        if step is None or poses is None or step.best >= len(poses):
            return
        self._times.append(time)
        self._rows.append((before.odometry, now.odometry, poses[step.best], step.pose))

    def take(self) -> list[Prediction]:
        """The predictions of the updates that were noted since the last call."""
        if not self._rows:
            return []
        before, now, start, end = np.array(self._rows).swapaxes(0, 1)
        by_wheels, by_scans = se2.between(before, now), se2.between(start, end)
        poses = se2.compose(start, by_wheels)
        deviations = motion_prior(by_wheels, self._motion).precision[:, 0] ** -0.5  # along, across, in heading
        covariances = _turned(deviations, poses[:, 2])
        far, miss = _disagree(by_wheels, by_scans, deviations)
        self._times, times = [], self._times
        self._rows = []
        sentences = [
            self._sentence(*row) if apart else None
            for apart, *row in zip(far, times, miss, by_wheels, by_scans, strict=True)
        ]
        return [Prediction(*row) for row in zip(times, poses, covariances, sentences, strict=True)]

    def _sentence(self, time: Time, miss: NDArray[np.float64], by_wheels: Pose, by_scans: Pose) -> str | None:
        """What is said of an update whose motions by wheels and scans (3,) miss each other by (2,) [m, deg]."""
        before = self._repeats.say(time[0], *miss.tolist())
        if before is None:
            return None
        return f"the odometry disagrees: wheels {_in_words(by_wheels)}, scans {_in_words(by_scans)}{before}"


def _turned(deviations: NDArray[np.float64], headings: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariances (n, 3, 3) from deviations along, across and in heading (n, 3), of robots with these headings (n,)."""
    axes = np.zeros((len(headings), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(headings)
    axes[:, 1, 0] = np.sin(headings)
    axes[:, 0, 1] = -axes[:, 1, 0]
    axes[:, 2, 2] = 1.0
    scaled = axes * deviations[:, None]
    covariances: NDArray[np.float64] = scaled @ scaled.swapaxes(1, 2)
    return covariances


def _disagree(
    by_wheels: Pose, by_scans: Pose, deviations: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether the motions (n, 3) lie further apart than the odometry's deviations (n, 3) explain, (n,), and how far
    [m, deg], (n, 2)."""
    miss = se2.between(by_wheels, by_scans)
    metres, degrees = np.hypot(miss[:, 0], miss[:, 1]), np.abs(np.degrees(miss[:, 2]))
    sigma_m, sigma_deg = np.hypot(deviations[:, 0], deviations[:, 1]), np.degrees(deviations[:, 2])
    far: NDArray[np.bool_] = (metres > np.maximum(MIN_MISS_M, MAX_SIGMAS * sigma_m)) | (
        degrees > np.maximum(MIN_MISS_DEG, MAX_SIGMAS * sigma_deg)
    )
    return far, np.column_stack([metres, degrees])


def _in_words(motion: Pose) -> str:
    degrees = round(float(np.degrees(motion[2]))) + 0  # no "-0"
    return f"{np.hypot(motion[0], motion[1]):.2f} m and {degrees}°"
