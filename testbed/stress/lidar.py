# SPDX-License-Identifier: MIT
"""Scans that say less, or say it less precisely, for the whole drive."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from slam import se2
from slam.scan import Scan
from slam.se2 import wrap_angle
from testbed.frame import Frame


def drop_scans(frames: Iterable[Frame], share: float, rng: Generator) -> Iterator[Frame]:
    """Lose a share of the scans, each by chance; the wheels' frames stay."""
    for frame in frames:
        lost = frame.scan is not None and rng.random() < share
        yield replace(frame, scan=None) if lost else frame


def add_range_noise(frames: Iterable[Frame], metres: float, rng: Generator) -> Iterator[Frame]:
    """Add a normal error of this standard deviation [m] to each range that hit something.

    A reading may leave the lidar's range by it: then it is no return, or too near to be valid.
    """

    def noisy(scan: Scan) -> Scan:
        errors = metres * rng.standard_normal(len(scan.ranges))
        return replace(scan, ranges=np.where(scan.hit, np.maximum(scan.ranges + errors, 0.0), scan.ranges))

    return _each_scan(frames, noisy)


def lose_beams(frames: Iterable[Frame], share: float, rng: Generator) -> Iterator[Frame]:
    """Lose a share of the beams of each scan, each by chance: their readings are invalid (NaN)."""

    def thinned(scan: Scan) -> Scan:
        return replace(scan, ranges=np.where(rng.random(len(scan.ranges)) < share, np.nan, scan.ranges))

    return _each_scan(frames, thinned)


def narrow_view(frames: Iterable[Frame], degrees: float) -> Iterator[Frame]:
    """Leave a field of view of so many degrees about the lidar's forward direction: other beams are invalid (NaN).

    The beams stay in the scan, so that recordings need not say when the first that is left was measured.
    """

    def narrowed(scan: Scan) -> Scan:
        inside = np.abs(wrap_angle(scan.angles)) <= 0.5 * math.radians(degrees)
        return replace(scan, ranges=np.where(inside, scan.ranges, np.nan))

    return _each_scan(frames, narrowed)


def use_fewer_beams(frames: Iterable[Frame], beams: float) -> Iterator[Frame]:
    """Keep each k-th beam, with the smallest k that leaves at most so many."""

    def fewer(scan: Scan) -> Scan:
        step = max(math.ceil(len(scan.angles) / beams), 1)
        times = None if scan.time_offsets is None else scan.time_offsets[::step]
        return replace(scan, ranges=scan.ranges[::step], angles=scan.angles[::step], time_offsets=times)

    return _each_scan(frames, fewer)


def mount_askew(frames: Iterable[Frame], degrees: float) -> Iterator[Frame]:
    """Let the lidar's mount be stated wrongly, turned counter-clockwise by so many degrees."""
    turn = np.array([0.0, 0.0, math.radians(degrees)])

    def askew(scan: Scan) -> Scan:
        x, y, theta = se2.compose(np.array(scan.mount), turn).tolist()
        return replace(scan, mount=(x, y, theta))

    return _each_scan(frames, askew)


def delay_stamps(frames: Sequence[Frame], seconds: float) -> Iterator[Frame]:
    """Stamp scans later than they were taken; odometry and truth stay those of the stamps.

    Each scan becomes a frame of its own between the others, which keep their order, their stamps (which may step back)
    and their odometry. Scans whose new stamp lies after the last frame are lost.
    """
    clock = np.maximum.accumulate([frame.stamp for frame in frames]).tolist()
    waiting: deque[tuple[float, Frame]] = deque()
    for row, frame in enumerate(frames):
        while waiting and waiting[0][0] < clock[row]:
            time, taken = waiting.popleft()
            share = (time - clock[row - 1]) / (clock[row] - clock[row - 1])
            yield _late(taken, seconds, frames[row - 1], frame, share)
        if frame.scan is not None:
            waiting.append((clock[row] + seconds, frame))
        yield replace(frame, scan=None)


def _late(taken: Frame, seconds: float, before: Frame, after: Frame, share: float) -> Frame:
    """A frame with its scan so much later, at a share of the motion between two frames."""
    scan, truth, stamp = taken.scan, None, taken.stamp + seconds
    assert scan is not None
    if before.truth is not None and after.truth is not None:
        truth = se2.compose(before.truth, share * se2.between(before.truth, after.truth))
    odometry = se2.compose(before.odometry, share * se2.between(before.odometry, after.odometry))
    return replace(
        before, stamp=stamp, odometry=odometry, truth=truth, lidar=taken.lidar, scan=replace(scan, stamp=stamp)
    )


def _each_scan(frames: Iterable[Frame], change: Callable[[Scan], Scan]) -> Iterator[Frame]:
    for frame in frames:
        yield frame if frame.scan is None else replace(frame, scan=change(frame.scan))
