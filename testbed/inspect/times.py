# SPDX-License-Identifier: MIT
"""Rates, gaps and order of the frames of a recording."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from slam import se2
from testbed.frame_table import BLOCK_FRAMES, FrameTable, Integers
from testbed.inspect.finding import Finding
from testbed.large_arrays import forget_pages

GAP_PERIODS, MIN_GAP = 5.0, 1.0
"""Scans are missing where the next one comes later than so many usual periods, and than this [s]."""
MOVED, TURNED = 0.5, math.radians(30.0)
"""A gap is doubtful if the robot moves further in it, by odometry [m], [rad]."""
REPEATED_SHARE = 0.01
"""Share of scans equal to the one before while the robot moves, from which on it is doubtful."""
STANDING = 1e-3
"""Motion between two scans [m], [rad] that counts as none."""


def scans_of(table: FrameTable, lidar: int) -> Integers:
    """Numbers of the scans of one lidar, in the order of the recording, (n,)."""
    return np.flatnonzero(table.scan_lidars == lidar)


def inspect_times(table: FrameTable) -> Iterator[Finding]:
    """Span, order of the stamps, and for each lidar its rate, gaps and repeated scans."""
    stamps = table.stamps
    span = float(np.ptp(stamps))
    yield Finding("frames", f"{len(table)}, {len(table.scan_rows)} of them with a scan, over {span:.1f} s")
    if back := int((np.diff(stamps) < 0.0).sum()):
        least = float(np.diff(stamps).min())
        found = f"stamps step back {back} times, by at most {-least:.3f} s"
        yield Finding("order", found, "doubtful" if least < -MIN_GAP else "ok", "used in the order of the file")
    for lidar, name in enumerate(table.lidars):
        scans = scans_of(table, lidar)
        if len(scans) > 1:
            yield from _rate(table, name, scans)
            yield from _repeated(table, name, scans)


def _rate(table: FrameTable, name: str, scans: Integers) -> Iterator[Finding]:
    rows = table.scan_rows[scans]
    periods = np.diff(table.stamps[rows])
    usual = float(np.median(periods))
    if usual <= 0.0:
        yield Finding(f"rate of {name}", "most scans have the stamp of the one before", "doubtful")
        return
    yield Finding(f"rate of {name}", f"{len(scans)} scans, {1.0 / usual:.2f} Hz")
    gaps = np.flatnonzero(periods > max(GAP_PERIODS * usual, MIN_GAP))
    if not gaps.size:
        return
    moves = se2.between(table.odometry[rows[gaps]], table.odometry[rows[gaps + 1]])
    far = (np.hypot(moves[:, 0], moves[:, 1]) > MOVED) | (np.abs(moves[:, 2]) > TURNED)
    longest = gaps[np.argmax(periods[gaps])]
    found = f"{gaps.size} gap{'' if gaps.size == 1 else 's'} without scans, the longest {periods[longest]:.1f} s at "
    found += f"{table.stamps[rows[longest]] - table.stamps[0]:.1f} s"
    if far.any():
        found += f"; the robot moves on in {int(far.sum())} of them"
        yield Finding(f"gaps of {name}", found, "doubtful", "odometry alone carries the path there")
    else:
        yield Finding(f"gaps of {name}", found + "; the robot hardly moves in them")


def _repeated(table: FrameTable, name: str, scans: Integers) -> Iterator[Finding]:
    """Scans that repeat the one before while the robot moves: of a lidar or driver that hangs."""
    rows, starts = table.scan_rows[scans], table.scan_starts
    moves = np.abs(se2.between(table.odometry[rows[:-1]], table.odometry[rows[1:]])).max(axis=1)
    repeated = 0
    for k in np.flatnonzero(moves > STANDING).tolist():
        first, second = (table.ranges[starts[n] : starts[n + 1]] for n in (scans[k], scans[k + 1]))
        repeated += len(first) > 0 and np.array_equal(first, second, equal_nan=True)
        if k % BLOCK_FRAMES == 0:
            forget_pages(table.ranges)
    if repeated > REPEATED_SHARE * len(scans):
        found = f"{repeated} of {len(scans)} scans repeat the one before while the robot moves"
        yield Finding(f"scans of {name}", found, "doubtful", "used as they are: a lidar or driver that hangs?")
