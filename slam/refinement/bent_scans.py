# SPDX-License-Identifier: MIT
"""Scans that were laid out with a motion that the robot did not make: laid out anew as it moved by the path.

While a wheel slips the odometry reports turns of hundreds of degrees a second. A scan whose beams are moved together by
such a turn is bent, lies on no wall, and is drawn where there is none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2

MAX_BEND = np.radians(1.0)
"""A scan is bent if odometry and path disagree by more than this turn within half a sweep [rad], besides what a robot
that accelerates may have turned: headings of a path err by less."""
MAX_TURN_ACCELERATION = 8.0
"""A robot's turn rate changes no faster [rad/s^2]: that of the quickest preset (Create 3). Between scans that are
seconds apart it may have changed in any way, and the path tells nothing of the motion within a scan."""


class Sweeps(NamedTuple):
    """The scans whose beams have times, in the order of the recording."""

    taken: NDArray[np.int64]
    """Frames with which they were taken, (scans,)."""
    frames: NDArray[np.int64]
    """Frames from which they are seen, (scans,)."""
    seconds: NDArray[np.float64]
    """Times between their first and last beams [s], (scans,)."""
    twists: NDArray[np.float64]
    """Velocities with which they were laid out: those by odometry, 0 where no robot reaches it, (scans, 3)."""


def path_twists(sweeps: Sweeps, poses: se2.Pose, stamps: NDArray[np.float64]) -> dict[int, NDArray[np.float64]]:
    """Velocities (3,) by the path of the scans that are bent, by their number in `sweeps`.

    poses (frames, 3), stamps (frames,) [s]. The velocity is that between the nearest scans before and after that are
    not bent, since the pose of a bent scan is not known well.
    """
    frames, n = sweeps.frames, len(sweeps.frames)
    # the pose of one bent scan is in the velocities of its neighbours too, but not in those on their other side
    spans = [(np.arange(n) + begin).clip(0, n - 1) for begin in (-2, -1, 1, 2)]
    pairs = (spans[1], spans[2]), (spans[0], spans[1]), (spans[2], spans[3])
    bends = [_bend(sweeps, poses, stamps, frames[begin], frames[end]) for begin, end in pairs]
    bent = np.min(bends, axis=0) > MAX_BEND
    straight = np.flatnonzero(~bent)
    if not bent.any() or len(straight) < 2:
        return {}
    numbers = np.flatnonzero(bent)
    at = np.searchsorted(straight, numbers).clip(1, len(straight) - 1)
    found = _twists(poses, stamps, frames[straight[at - 1]], frames[straight[at]])
    return dict(zip(numbers.tolist(), found, strict=True))


def misplaced_scans(
    sweeps: Sweeps, bent: NDArray[np.int64], poses: se2.Pose, stamps: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Numbers of the scans that are not bent but lie turned against both neighbours, by what the wheels reported there.

    bent: numbers of the scans that are;  poses (frames, 3), stamps (frames,) [s]. Where wheels slip, the path begins
    with turns of tens of degrees between two scans; more than the gates of the adjustment let it find back from. Such
    a scan turns away from the one before it and back to the one after it, at least once faster than a robot can.
    """
    straight = np.setdiff1d(np.arange(len(sweeps.frames)), bent)
    frames, rates = sweeps.frames[straight], sweeps.twists[straight, 2]
    seconds = np.diff(stamps[frames])
    turned = se2.between(poses[frames[:-1]], poses[frames[1:]])[:, 2]
    off = se2.wrap_angle(turned - 0.5 * seconds * (rates[:-1] + rates[1:]))
    possible = 2.0 * MAX_BEND + 0.25 * MAX_TURN_ACCELERATION * seconds**2  # from one known rate to another
    away = np.minimum(np.abs(off[:-1]), np.abs(off[1:])) > 2.0 * MAX_BEND
    too_fast = np.maximum(np.abs(off[:-1]) - possible[:-1], np.abs(off[1:]) - possible[1:]) > 0.0
    found: NDArray[np.int64] = straight[1:-1][away & too_fast & (off[:-1] * off[1:] < 0.0)]
    return found


def _bend(
    sweeps: Sweeps,
    poses: se2.Pose,
    stamps: NDArray[np.float64],
    begin: NDArray[np.int64],
    end: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Turn within half a sweep by which odometry and path disagree [rad], (scans,), the path's from frames `begin` to
    frames `end`; less what the turn rate in the middle of that time may differ from its mean."""
    differ = np.abs(sweeps.twists[:, 2] - _twists(poses, stamps, begin, end)[:, 2])
    return 0.5 * sweeps.seconds * (differ - 0.25 * MAX_TURN_ACCELERATION * (stamps[end] - stamps[begin]))


def _twists(
    poses: se2.Pose, stamps: NDArray[np.float64], begin: NDArray[np.int64], end: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Mean velocities (n, 3) between the poses of two frames each, in the robot's frame; 0 within no time."""
    seconds = stamps[end] - stamps[begin]
    moved = se2.between(poses[begin], poses[end])
    return np.divide(moved, seconds[:, None], out=np.zeros_like(moved), where=seconds[:, None] > 0.0)


def between_neighbours(frames: NDArray[np.int64], bent: NDArray[np.int64], poses: se2.Pose) -> se2.Pose:
    """Poses (frames, 3) with those of the scans number `bent` (k,), and of the frames about them, evenly between the
    nearest scans that are not among them."""
    result = poses.copy()
    straight = np.setdiff1d(np.arange(len(frames)), bent)
    for number in bent.tolist():
        at = int(np.searchsorted(straight, number))
        if at in (0, len(straight)):
            continue
        begin, end = int(frames[straight[at - 1]]), int(frames[straight[at]])
        share = (np.arange(begin + 1, end) - begin) / (end - begin)
        result[begin + 1 : end] = se2.compose(poses[begin], share[:, None] * se2.between(poses[begin], poses[end]))
    return result
