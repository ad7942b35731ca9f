# SPDX-License-Identifier: MIT
"""Scans whose beams have no times of their own, though they were taken one after the other.

The first and the last beam of a full turn look the same way. If they were taken a turn apart, the robot's motion makes
a jump between them, which the odometry predicts; if the scan was taken at once, or its driver has laid it out so, there
is none. What share of the predicted jumps is there tells in which order the beams were taken, and how fast.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from slam import se2
from testbed.formats import Log
from testbed.formats.beams import even_spacing
from testbed.frame_table import BeamPattern, Floats, FrameTable, Integers
from testbed.inspect.turns import robust_scale

SEAM_BEAMS = 6
"""So many beams on both sides show the jump at the seam."""
MAX_REST = 0.1
"""Where readings around the seam are further from two parallel lines [m], there is an edge."""
MIN_SCANS, MIN_SHARE, SIGNIFICANT = 30, 0.7, 5.0
"""So many scans are needed; so much of the predicted jumps must be there, and so many of its standard deviations."""
MAX_PERIOD = 0.5
"""Longest turn of a lidar [s]."""


def with_beam_times(log: Log) -> Log:
    """The log with times for the beams of lidars that turn without a pause and do not state them, with a note."""
    table, notes = log.table, []
    for lidar, name in enumerate(table.lidars):
        scans = np.flatnonzero(table.scan_lidars == lidar)
        if len(scans) <= MIN_SCANS or not _is_timeless_turn(table, scans):
            continue
        period = float(np.median(np.diff(table.stamps[table.scan_rows[scans]])))
        if not 0.0 < period <= MAX_PERIOD:
            continue
        seen, expected = _jumps(table, scans, period)
        if len(seen) < MIN_SCANS:
            continue
        share, uncertainty = robust_scale(seen, expected)
        if not abs(share) > max(MIN_SHARE, SIGNIFICANT * uncertainty):
            continue
        table = _swept(table, scans, period, backward=share < 0.0)
        notes.append(
            f"beams of {name or 'the lidar'} have no times, but the last of a scan was taken {abs(share):.2f} ± "
            f"{uncertainty:.2f} periods {'after' if share > 0.0 else 'before'} the first: they are taken as a turn of "
            f"{period:.3f} s that begins at the stamp{'' if share > 0.0 else ', with the last beam'}"
        )
    return replace(log, table=table, notes=(*log.notes, *notes), repairs=(*log.repairs, *notes)) if notes else log


def _is_timeless_turn(table: FrameTable, scans: Integers) -> bool:
    """Whether all scans are full turns of evenly spaced beams without times."""
    for k in np.unique(table.scan_patterns[scans]).tolist():
        pattern = table.patterns[k]
        spacing = even_spacing(pattern.angles)
        if pattern.time_offsets is not None or spacing is None or pattern.angles.size < 4 * SEAM_BEAMS:
            return False
        if abs(pattern.angles.size * abs(spacing[1]) - 2.0 * math.pi) > 1.5 * abs(spacing[1]):
            return False
    return True


def _jumps(table: FrameTable, scans: Integers, period: float) -> tuple[Floats, Floats]:
    """The jumps from the first to the last beam of scans [m], and those that odometry predicts for beams that are a
    period [s] apart, (n,) each; scans with an edge at the seam are left out."""
    scans, rows = scans[:-1], table.scan_rows[scans]
    near = np.arange(SEAM_BEAMS)
    at = np.concatenate(
        [table.scan_starts[scans + 1, None] - SEAM_BEAMS + near, table.scan_starts[scans, None] + near], 1
    )
    readings, limits = np.asarray(table.ranges[at], dtype=np.float64), table.range_limits[scans]
    hit = (readings >= limits[:, :1]) & (readings > 0.0) & (readings < limits[:, 1:])
    own = table.scan_patterns[scans]
    first = np.array([p.angles[0] if p.angles.size else 0.0 for p in table.patterns])[own]
    step = np.array([p.angles[1] - p.angles[0] if p.angles.size > 1 else 0.0 for p in table.patterns])[own]
    beams = np.arange(2 * SEAM_BEAMS) - (SEAM_BEAMS - 0.5)
    design = np.stack([np.ones(len(beams)), beams, np.where(beams < 0.0, 0.5, -0.5)], axis=1)
    readings = np.where(hit, readings, 0.0)
    middle, slope, jump = fitted = np.linalg.pinv(design) @ readings.T
    rest = np.abs(readings - (design @ fitted).T).max(axis=1)
    moves = se2.between(*(se2.compose(table.odometry[r], table.mounts[scans]) for r in (rows[:-1], rows[1:])))
    times = np.diff(table.stamps[rows])
    moves *= np.divide(period, times, out=np.full(len(times), np.nan), where=times > 0.0)[:, None]
    direction = first - 0.5 * step
    ahead = moves[:, 0] * np.cos(direction) + moves[:, 1] * np.sin(direction)
    aside = moves[:, 1] * np.cos(direction) - moves[:, 0] * np.sin(direction)
    slope = slope / step  # of the wall [m/rad]
    kept = hit.all(axis=1) & (rest < MAX_REST) & (middle > 0.0) & np.isfinite(moves).all(axis=1)
    expected = -ahead[kept] + slope[kept] * (aside[kept] / middle[kept] + moves[kept, 2])
    return jump[kept], expected


def _swept(table: FrameTable, scans: Integers, period: float, *, backward: bool) -> FrameTable:
    """The table with the beams of some scans in the order of a turn, with times."""
    patterns, numbers, ranges = list(table.patterns), table.scan_patterns.copy(), table.ranges
    for k in np.unique(numbers[scans]).tolist():
        angles = table.patterns[k].angles
        times = period / angles.size * np.arange(angles.size)
        numbers[scans[table.scan_patterns[scans] == k]] = len(patterns)
        patterns.append(BeamPattern(angles=angles[::-1] if backward else angles, time_offsets=times))
    if backward:
        ranges = ranges.copy()
        for k in scans.tolist():
            begin, end = table.scan_starts[k : k + 2].tolist()
            ranges[begin:end] = table.ranges[begin:end][::-1]
    return replace(table, patterns=tuple(patterns), scan_patterns=numbers, ranges=ranges)
