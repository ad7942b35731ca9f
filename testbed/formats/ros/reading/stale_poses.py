# SPDX-License-Identifier: MIT
"""Odometry whose poses, or a part of them, do not change while its twists say that the robot moves."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from testbed.formats.ros.reading.decode import Track

MIN_WAY, MIN_TURN = 0.1, math.radians(10.0)
"""Twists that add up to less motion [m], [rad] show nothing."""
MOVING, TURNING = 0.01, 0.01
"""Twists above these [m/s], [rad/s] say that the robot moves."""
STALE_SHARE = 0.3
"""Largest share of messages that repeat a pose although the robot moves, where poses are sent when they are known."""


def with_fresh_poses(track: Track) -> tuple[Track, list[str]]:
    """Odometry, sorted by time, with poses that follow its motion, and notes.

    A position or heading that never changes is made of the twists; of poses that are sent again and again before they
    change, the first counts.
    """
    if len(track.stamps) < 2 or not np.isfinite(track.twists).all():
        return track, []
    track, notes = _by_twists(track)
    return (track, notes) if notes else _without_repeats(track)


def _by_twists(track: Track) -> tuple[Track, list[str]]:
    """Odometry with the position or heading that its twists make, where it is constant and they are not zero."""
    spans = np.diff(track.stamps)
    rates = 0.5 * (track.twists[:-1] + track.twists[1:])  # drivers mean the step before or the one behind a message
    steps = rates * spans[:, None]
    still = (np.ptp(track.poses[:, :2], axis=0) == 0.0).all() and np.hypot(*steps[:, :2].T).sum() > MIN_WAY
    straight = float(np.ptp(track.poses[:, 2])) == 0.0 and np.abs(steps[:, 2]).sum() > MIN_TURN
    if not (still or straight):
        return track, []
    poses = track.poses.copy()
    if straight:
        poses[1:, 2] = poses[0, 2] + np.cumsum(steps[:, 2])
    if still:
        middle = poses[:-1, 2] + 0.5 * steps[:, 2]
        cos, sin = np.cos(middle), np.sin(middle)
        moves = np.column_stack([cos * steps[:, 0] - sin * steps[:, 1], sin * steps[:, 0] + cos * steps[:, 1]])
        poses[1:, :2] = poses[0, :2] + np.cumsum(moves, axis=0)
    what = "pose" if still and straight else "position" if still else "heading"
    note = f"the {what} of the odometry never changes, but its twists are not zero: the path is made of the twists"
    return track._replace(poses=poses), [note]


def _without_repeats(track: Track) -> tuple[Track, list[str]]:
    """Odometry without the messages that repeat the pose before although the robot moves."""
    alike = np.append(False, (np.diff(track.poses, axis=0) == 0.0).all(axis=1))
    moves: NDArray[np.bool_] = np.hypot(track.twists[:, 0], track.twists[:, 1]) > MOVING
    moves |= np.abs(track.twists[:, 2]) > TURNING
    stale = alike & moves
    if stale.sum() <= STALE_SHARE * max(int(moves.sum()), 1) or not (~alike).sum() > 1:
        return track, []
    kept = ~stale
    kept[-1] = kept[-1] or not moves[-1]
    note = (
        f"{int(stale.sum())} messages of odometry repeat the pose before while their twists say that the robot moves: "
        "they are left out, and poses are interpolated"
    )
    return track.chosen(kept), [note]
