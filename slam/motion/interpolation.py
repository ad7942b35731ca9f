# SPDX-License-Identifier: MIT
"""Poses at every frame of a recording, interpolated by odometry between frames with known poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.se2 import Pose

TURN_LENGTH = 0.5
"""Length that one radian of turning counts as, when the residual between two known poses is distributed [m]."""
MIN_CARRIED = 0.1
"""A robot was carried if it is farther from where its wheels say than twice the way that they counted, as where they
count backward, and this [m]."""


def between_updates(odometry: Pose, updates: NDArray[np.intp], path: Pose) -> Pose:
    """Return poses (m, 3) at all frames, from a filter's path (k, 3) at its updates.

    odometry (m, 3): of all frames;  updates (k,): frames of the updates

    As `interpolate_with_odometry`, but where an update moves the robot by more than its wheels can have miscounted, it
    was carried, and the frames before it follow the odometry: a filter updates at the first scan that shows a jump
    (`GMapping._surprises`). To distribute the jump would put scans between both places.
    """
    motions = se2.between(odometry[:-1], odometry[1:])
    way = np.diff(way_along(motions)[updates])
    expected = se2.between(odometry[updates[:-1]], odometry[updates[1:]])
    apart = se2.between(expected, se2.between(path[:-1], path[1:]))
    carried = np.hypot(apart[:, 0], apart[:, 1]) + TURN_LENGTH * np.abs(apart[:, 2]) > 2.0 * way + MIN_CARRIED
    return interpolate_with_odometry(odometry, updates, path, carried)


def interpolate_with_odometry(
    odometry: Pose, known: NDArray[np.intp], poses: Pose, late: NDArray[np.bool_] | None = None
) -> Pose:
    """Return poses (m, 3) at all frames, which equal `poses` at `known`.

    odometry (m, 3): of all frames, in its own drifting frame; known (k,): increasing indices of the frames whose pose
    is known, k >= 1; poses (k, 3): those poses; late (k - 1,): whether the residual between two known poses arose at
    the second of them, and is not distributed

    Between two known poses the result follows the odometry from the first one, and the residual at the second one is
    distributed in proportion to the distance travelled, where turning counts by `TURN_LENGTH`. Before the first and
    after the last known pose it follows the odometry.
    """
    if len(known) == 0 or len(known) != len(poses):
        raise ValueError(f"expected one pose for each known frame and at least one, got {len(known)} and {len(poses)}")
    frames = np.arange(len(odometry))
    before = np.maximum(np.searchsorted(known, frames, side="right") - 1, 0)
    after = np.minimum(before + 1, len(known) - 1)
    after[frames <= known[0]] = 0
    forward = se2.compose(poses[before], se2.between(odometry[known[before]], odometry))
    backward = se2.compose(poses[after], se2.between(odometry[known[after]], odometry))

    step = se2.between(odometry[:-1], odometry[1:])
    way = way_along(step)
    length = way[known[after]] - way[known[before]]
    share = np.divide(way - way[known[before]], length, out=np.zeros(len(frames)), where=length > 0.0)
    if late is not None and len(late):
        share[late[np.minimum(before, len(late) - 1)]] = 0.0
    share[frames == known[after]] = 1.0
    share[before == after] = 0.0
    return _blend(forward, backward, share)


def way_along(steps: Pose) -> NDArray[np.float64]:
    """Distance driven and turned up to each of the frames that the steps (m - 1, 3) lie between, (m,) [m]."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + TURN_LENGTH * np.abs(steps[:, 2]))])


def _blend(a: Pose, b: Pose, share: NDArray[np.float64]) -> Pose:
    """Return poses (m, 3) between a, where share (m,) is 0, and b, where it is 1; headings turn the short way."""
    blended = a.copy()
    blended[:, :2] += share[:, None] * (b[:, :2] - a[:, :2])
    blended[:, 2] = se2.wrap_angle(a[:, 2] + share * se2.wrap_angle(b[:, 2] - a[:, 2]))
    return blended
