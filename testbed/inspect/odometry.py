# SPDX-License-Identifier: MIT
"""Whether the odometry of a recording can be that of a robot, and how it agrees with the scans."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from slam import se2
from slam.motion.continuous_odometry import has_jumped
from testbed.frame_table import Floats, FrameTable
from testbed.inspect.finding import Finding
from testbed.inspect.turns import Clock

MIN_RATE = 2.0
"""Odometry that comes more rarely [Hz] says little of how the robot turned between two of its poses."""
TOLERATED_SCALE = 0.15
"""Turns by scans and odometry may differ by this share."""
CERTAIN = 4.0
"""A difference of so many standard deviations is no chance."""
MAX_SCALE_UNCERTAINTY = 0.05
MIN_CHORDS, MIN_CHORD_POSES = 0.5, 100
"""Every second pose of a path makes nearly its whole length; where so little, two paths take turns."""


def inspect_odometry(table: FrameTable, clock: Clock | None) -> Iterator[Finding]:
    """Length, speed, jumps, rate, and the agreement with the turns that the scans show."""
    stamps, steps, spans = table.stamps, se2.between(table.odometry[:-1], table.odometry[1:]), np.diff(table.stamps)
    if not (spans > 0.0).any():
        return
    jumps = has_jumped(steps, spans)
    length = np.where(jumps, 0.0, np.hypot(steps[:, 0], steps[:, 1]))
    turn = np.where(jumps, 0.0, np.abs(steps[:, 2]))
    speed = _speed(stamps, np.concatenate([[0.0], np.cumsum(length)]))
    found = f"{length.sum():.1f} m and {turn.sum() / (2.0 * math.pi):.1f} turns, {speed:.2f} m/s at most"
    if length.sum() == 0.0 and turn.sum() == 0.0:
        yield Finding("odometry", "the pose never changes", "doubtful", "scan matching alone carries the path")
        return
    yield Finding("odometry", found)
    if jumps.any():
        first = int(np.flatnonzero(jumps)[0])
        found = f"{int(jumps.sum())} jumps that no robot can make, the first at {stamps[first] - stamps[0]:.1f} s"
        yield Finding("odometry's jumps", found, "mended", "the path is joined there")
    if (to_and_fro := _to_and_fro(table)) < MIN_CHORDS:
        found = f"every second pose makes {to_and_fro:.0%} of the way of all: it goes to and fro"
        yield Finding("odometry's path", found, "doubtful", "used as it is: do two programs send it?")
    rate = float(1.0 / np.median(spans[spans > 0.0]))
    if rate < MIN_RATE:
        found = f"{rate:.2f} Hz"
        yield Finding("odometry's rate", found, "doubtful", "poses are interpolated: turns between them are lost")
    yield from _agreement(clock)


def _to_and_fro(table: FrameTable) -> float:
    """Length of the way through every second of the poses that differ, as a share of that through all of them."""
    places = table.odometry[:, :2]
    moved = np.append(True, (np.diff(places, axis=0) != 0.0).any(axis=1))
    places = places[moved]
    if len(places) < MIN_CHORD_POSES:
        return 1.0
    all_steps, second = np.diff(places, axis=0), places[2:] - places[:-2]
    return float(0.5 * np.hypot(*second.T).sum() / np.hypot(*all_steps.T).sum())


def _speed(stamps: Floats, driven: Floats) -> float:
    """The largest mean speed over a second [m/s], but for one second in a hundred."""
    order = np.argsort(stamps, kind="stable")
    times = stamps[order] - stamps[order[0]]
    seconds = np.unique(np.floor(times))  # those in which there are frames: a gap may be of any length
    speeds = np.diff(np.interp(seconds, times, np.maximum.accumulate(driven[order]))) / np.diff(seconds)
    return float(np.percentile(speeds, 99.0)) if speeds.size else float(driven[-1] / max(times[-1], 1e-9))


def _agreement(clock: Clock | None) -> Iterator[Finding]:
    if clock is None or clock.scale_uncertainty > MAX_SCALE_UNCERTAINTY:
        yield Finding("scans and odometry", "the robot turns too little, or scans are too rare, to compare them")
        return
    scale = f"scans turn {clock.scale:.2f} ± {clock.scale_uncertainty:.2f} times as far as odometry"
    if abs(clock.scale - 1.0) > max(TOLERATED_SCALE, CERTAIN * clock.scale_uncertainty):
        mirrored = "used as they are: is the lidar upside down, or angle_increment negative?"
        yield Finding("turns", scale, "doubtful", mirrored if clock.scale < 0.0 else "used as they are: a wrong track?")
    else:
        yield Finding("turns", scale)
    if not math.isfinite(clock.uncertainty):
        return
    late = f"stamps of scans are {clock.offset:+.3f} ± {clock.uncertainty:.3f} s later than those of odometry"
    if clock.is_off:
        yield Finding("clocks", late, "doubtful", "--time-offset auto takes it back")
    else:
        yield Finding("clocks", late)
