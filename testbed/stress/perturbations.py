# SPDX-License-Identifier: MIT
"""Faults as functions from frames to frames. Times are stamps of the frames that come in [s].

Each changes what the sensors say and, where the robot itself is moved, the truth; frames that come out are new objects.
A fault at several times takes the time at which each begins, in increasing order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam.se2 import Pose
from testbed.frame import Frame

SLIP_SECONDS = 0.5
"""Time that one slip takes [s]."""


def change_odometry(
    frames: Iterable[Frame], at: ArrayLike, seconds: float, change: Callable[[Pose, float], Pose]
) -> Iterator[Frame]:
    """Let the wheels report something else for some seconds.

    change: from the displacement (3,) between two frames and the share of the fault's time that falls between them to
    the displacement that is reported
    """
    begins = np.atleast_1d(np.asarray(at, dtype=np.float64))
    before: Frame | None = None
    odometry = np.zeros(3)
    for frame in frames:
        if before is None:
            odometry = frame.odometry
        else:
            share = _overlap(before.stamp, frame.stamp, begins, seconds) / seconds
            step = se2.between(before.odometry, frame.odometry)
            odometry = se2.compose(odometry, change(step, share) if share > 0.0 else step)
        before = frame
        yield replace(frame, odometry=odometry)


def slip(frames: Iterable[Frame], at: ArrayLike, motion: Pose, seconds: float = SLIP_SECONDS) -> Iterator[Frame]:
    """Let the wheels report a motion (3,) [m, m, rad] that the robot does not make, evenly over some seconds."""
    extra = np.asarray(motion, dtype=np.float64)
    for frame in change_odometry(frames, at, seconds, lambda step, share: se2.compose(step, share * extra)):
        yield _with_twist(frame, at, seconds, lambda twist: twist + extra / seconds)


def stop_odometry(frames: Iterable[Frame], at: ArrayLike, seconds: float) -> Iterator[Frame]:
    """Let the wheels' counters stand still for some seconds."""
    for frame in change_odometry(frames, at, seconds, lambda step, _: np.zeros(3)):
        yield _with_twist(frame, at, seconds, np.zeros_like)


def reverse_odometry(frames: Iterable[Frame], at: ArrayLike, seconds: float) -> Iterator[Frame]:
    """Let the wheels' counters count backward for some seconds."""
    for frame in change_odometry(frames, at, seconds, lambda step, _: se2.inverse(step)):
        yield _with_twist(frame, at, seconds, np.negative)


def carry(frames: Iterable[Frame], at: ArrayLike, seconds: float) -> Iterator[Frame]:
    """Cut some seconds out: the robot stands elsewhere at once, and its wheels have noticed nothing.

    A second or two are a push, more of them carry the robot away. Later stamps are earlier by what was cut out.
    """
    begins = np.atleast_1d(np.asarray(at, dtype=np.float64))
    last: Pose | None = None  # what was reported before the cut
    cuts = 0
    before, odometry = np.zeros(3), np.zeros(3)
    for frame in frames:
        if _lies_in(frame.stamp, begins, seconds):
            continue
        passed = int(np.searchsorted(begins, frame.stamp, side="right"))
        if last is None or passed == 0:
            odometry = frame.odometry
        elif passed == cuts:
            odometry = se2.compose(odometry, se2.between(before, frame.odometry))
        cuts, before, last = passed, frame.odometry, odometry
        yield frame if passed == 0 else _earlier(replace(frame, odometry=odometry), passed * seconds)


def blind(frames: Iterable[Frame], at: ArrayLike, seconds: float) -> Iterator[Frame]:
    """Let the lidar see nothing for some seconds: all its beams return nothing."""
    for frame in frames:
        if frame.scan is None or not _lies_in(frame.stamp, at, seconds):
            yield frame
        else:
            nothing = np.full(len(frame.scan.ranges), np.inf)
            yield replace(frame, scan=replace(frame.scan, ranges=nothing))


def lose_scans(frames: Iterable[Frame], at: ArrayLike, seconds: float) -> Iterator[Frame]:
    """Drop all scans of some seconds; the wheels' frames stay."""
    for frame in frames:
        yield replace(frame, scan=None) if _lies_in(frame.stamp, at, seconds) else frame


def thin_scans(frames: Iterable[Frame], seconds: float) -> Iterator[Frame]:
    """Keep a scan of each lidar only when so many seconds have passed since its last one; the wheels' frames stay."""
    kept: dict[str, float] = {}
    for frame in frames:
        if frame.scan is not None and frame.stamp < kept.get(frame.lidar, -math.inf) + seconds:
            yield replace(frame, scan=None)
        else:
            if frame.scan is not None:
                kept[frame.lidar] = frame.stamp
            yield frame


def space_scans(frames: Iterable[Frame], metres: float) -> Iterator[Frame]:
    """Keep a scan of each lidar only when the wheels have counted so many metres of path since its last one."""
    kept: dict[str, float] = {}
    path, before = 0.0, None
    for frame in frames:
        if before is not None:
            path += math.hypot(*(frame.odometry[:2] - before[:2]))
        before = frame.odometry
        if frame.scan is not None and path < kept.get(frame.lidar, -math.inf) + metres:
            yield replace(frame, scan=None)
        else:
            if frame.scan is not None:
                kept[frame.lidar] = path
            yield frame


def limit_range(frames: Iterable[Frame], metres: float) -> Iterator[Frame]:
    """Let the lidar see no farther than so many metres: what is beyond returns nothing."""
    for frame in frames:
        if frame.scan is None:
            yield frame
        else:
            ranges = np.where(frame.scan.ranges < metres, frame.scan.ranges, np.inf)
            yield replace(frame, scan=replace(frame.scan, ranges=ranges, range_max=min(metres, frame.scan.range_max)))


def restart_odometry(frames: Iterable[Frame], at: ArrayLike) -> Iterator[Frame]:
    """Let the odometry begin anew at its origin."""
    begins = np.atleast_1d(np.asarray(at, dtype=np.float64))
    origin, starts = np.zeros(3), 0
    for frame in frames:
        passed = int(np.searchsorted(begins, frame.stamp, side="right"))
        if passed > starts:
            origin, starts = frame.odometry, passed
        yield frame if starts == 0 else replace(frame, odometry=se2.between(origin, frame.odometry))


def _with_twist(frame: Frame, at: ArrayLike, seconds: float, change: Callable[[Pose], Pose]) -> Frame:
    """The frame with another twist, if it has one and lies in the fault's time."""
    if frame.twist is None or not _lies_in(frame.stamp, at, seconds):
        return frame
    return replace(frame, twist=change(frame.twist))


def _lies_in(stamp: float, at: ArrayLike, seconds: float) -> bool:
    """Whether a stamp lies in the fault's time."""
    begins = np.atleast_1d(np.asarray(at, dtype=np.float64))
    passed = int(np.searchsorted(begins, stamp, side="right"))
    return passed > 0 and stamp < float(begins[passed - 1]) + seconds


def _overlap(start: float, stop: float, begins: NDArray[np.float64], seconds: float) -> float:
    """Length of the part of [start, stop] in which faults of so many seconds last."""
    first, last = np.searchsorted(begins, (start - seconds, stop)).tolist()
    near = begins[first:last]
    return float(np.maximum(np.minimum(stop, near + seconds) - np.maximum(start, near), 0.0).sum())


def _earlier(frame: Frame, seconds: float) -> Frame:
    """The frame with earlier stamps."""
    scan = frame.scan
    if scan is not None:
        scan = replace(scan, stamp=scan.stamp - seconds)
    return replace(frame, stamp=frame.stamp - seconds, scan=scan)
