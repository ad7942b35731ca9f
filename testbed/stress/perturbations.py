# SPDX-License-Identifier: MIT
"""Faults as functions from frames to frames. Times are stamps of the frames that come in [s].

Each changes what the sensors say and, where the robot itself is moved, the truth; frames that come out are new objects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from slam import se2
from slam.se2 import Pose
from testbed.frame import Frame


def change_odometry(
    frames: Iterable[Frame], at: float, seconds: float, change: Callable[[Pose, float], Pose]
) -> Iterator[Frame]:
    """Let the wheels report something else for some seconds.

    change: from the displacement (3,) between two frames and the share of the fault's time that falls between them to
    the displacement that is reported
    """
    before: Frame | None = None
    odometry = np.zeros(3)
    for frame in frames:
        if before is None:
            odometry = frame.odometry
        else:
            share = _overlap(before.stamp, frame.stamp, at, at + seconds) / seconds
            step = se2.between(before.odometry, frame.odometry)
            odometry = se2.compose(odometry, change(step, share) if share > 0.0 else step)
        before = frame
        yield replace(frame, odometry=odometry)


def slip(frames: Iterable[Frame], at: float, motion: Pose, seconds: float = 0.5) -> Iterator[Frame]:
    """Let the wheels report a motion (3,) [m, m, rad] that the robot does not make, evenly over some seconds."""
    extra = np.asarray(motion, dtype=np.float64)
    for frame in change_odometry(frames, at, seconds, lambda step, share: se2.compose(step, share * extra)):
        yield _with_twist(frame, at, seconds, lambda twist: twist + extra / seconds)


def stop_odometry(frames: Iterable[Frame], at: float, seconds: float) -> Iterator[Frame]:
    """Let the wheels' counters stand still for some seconds."""
    for frame in change_odometry(frames, at, seconds, lambda step, _: np.zeros(3)):
        yield _with_twist(frame, at, seconds, np.zeros_like)


def reverse_odometry(frames: Iterable[Frame], at: float, seconds: float) -> Iterator[Frame]:
    """Let the wheels' counters count backward for some seconds."""
    for frame in change_odometry(frames, at, seconds, lambda step, _: se2.inverse(step)):
        yield _with_twist(frame, at, seconds, np.negative)


def carry(frames: Iterable[Frame], at: float, seconds: float) -> Iterator[Frame]:
    """Cut some seconds out: the robot stands elsewhere at once, and its wheels have noticed nothing.

    A second or two are a push, more of them carry the robot away. Later stamps are earlier by what was cut out.
    """
    held: Pose | None = None  # odometry at the cut
    resumed: Pose | None = None  # what the wheels said after it
    for frame in frames:
        if frame.stamp < at:
            held = frame.odometry
            yield frame
        elif frame.stamp >= at + seconds:
            resumed = frame.odometry if resumed is None else resumed
            start = frame.odometry if held is None else held
            odometry = se2.compose(start, se2.between(resumed, frame.odometry))
            yield _earlier(replace(frame, odometry=odometry), seconds)


def blind(frames: Iterable[Frame], at: float, seconds: float) -> Iterator[Frame]:
    """Let the lidar see nothing for some seconds: all its beams return nothing."""
    for frame in frames:
        if frame.scan is None or not at <= frame.stamp < at + seconds:
            yield frame
        else:
            nothing = np.full(len(frame.scan.ranges), np.inf)
            yield replace(frame, scan=replace(frame.scan, ranges=nothing))


def lose_scans(frames: Iterable[Frame], at: float, seconds: float) -> Iterator[Frame]:
    """Drop all scans of some seconds; the wheels' frames stay."""
    for frame in frames:
        yield replace(frame, scan=None) if at <= frame.stamp < at + seconds else frame


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


def limit_range(frames: Iterable[Frame], metres: float) -> Iterator[Frame]:
    """Let the lidar see no farther than so many metres: what is beyond returns nothing."""
    for frame in frames:
        if frame.scan is None:
            yield frame
        else:
            ranges = np.where(frame.scan.ranges < metres, frame.scan.ranges, np.inf)
            yield replace(frame, scan=replace(frame.scan, ranges=ranges, range_max=min(metres, frame.scan.range_max)))


def restart_odometry(frames: Iterable[Frame], at: float) -> Iterator[Frame]:
    """Let the odometry begin anew at its origin."""
    origin: Pose | None = None
    for frame in frames:
        if frame.stamp < at:
            yield frame
        else:
            origin = frame.odometry if origin is None else origin
            yield replace(frame, odometry=se2.between(origin, frame.odometry))


def _with_twist(frame: Frame, at: float, seconds: float, change: Callable[[Pose], Pose]) -> Frame:
    """The frame with another twist, if it has one and lies in the fault's time."""
    if frame.twist is None or not at <= frame.stamp < at + seconds:
        return frame
    return replace(frame, twist=change(frame.twist))


def _overlap(start: float, stop: float, low: float, high: float) -> float:
    """Length of the part of [start, stop] within [low, high]."""
    return max(0.0, min(stop, high) - max(start, low))


def _earlier(frame: Frame, seconds: float) -> Frame:
    """The frame with earlier stamps."""
    scan = frame.scan
    if scan is not None:
        scan = replace(scan, stamp=scan.stamp - seconds)
    return replace(frame, stamp=frame.stamp - seconds, scan=scan)
