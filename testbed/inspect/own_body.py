# SPDX-License-Identifier: MIT
"""Beams that see parts of the robot itself, such as posts and cables: walls that go along with it.

Such a beam reads the same near range whichever way the robot looks. A beam at a wall does not: even of a robot that
follows walls the range changes where it turns.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from testbed.formats import Log
from testbed.frame_table import FrameTable, Integers
from testbed.large_arrays import forget_pages, joined

MAX_REACH = 0.8
"""Parts of a robot are nearer to its lidar than this [m]."""
TOLERANCE = 0.05
"""Readings of such a beam lie so near to their median [m], whatever the lidar's noise."""
SECTORS, MIN_SECTORS, PER_SECTOR, MIN_PER_SECTOR = 12, 6, 20, 3
"""Headings are counted in so many sectors of the circle, of which so many must have been looked at, with up to so many
scans each and no fewer than the last."""
MIN_SHARE, MAX_BEAMS = 0.95, 0.5
"""A beam is the robot's where so many of its readings, each sector counting alike, agree; where more than the second
share of the beams are, the lidar itself has stopped."""
BUNDLE_GAP, MAX_NAMED = 5.0, 3
"""Beams further apart [deg] are another bundle; so many bundles are named."""
PIECE = 4_000_000
"""Readings that are copied at a time."""
LET_GO = 256
"""Scans after which the memory of their file is let go of."""


def without_own_body(log: Log) -> Log:
    """The log with the readings of such beams unknown (NaN), with a note; the log itself where there are none."""
    table, notes = log.table, []
    for lidar, name in enumerate(log.table.lidars):
        scans = np.flatnonzero(table.scan_lidars == lidar)
        commonest = np.bincount(table.scan_patterns[scans]).argmax() if len(scans) else 0
        alike = scans[table.scan_patterns[scans] == commonest]
        ranges = _typical_ranges(table, alike)
        own = np.isfinite(ranges)
        if own.any() and own.mean() <= MAX_BEAMS:
            angles = table.patterns[commonest].angles
            table = _without(table, scans, angles, own)
            near, far = ranges[own].min(), ranges[own].max()
            notes.append(
                f"{own.sum()} beams of {name or 'the lidar'} ({_directions(angles[own])}) read the same "
                f"{near:.2f} to {far:.2f} m whichever way the robot looks: parts of the robot, taken as lost"
            )
    return replace(log, table=table, notes=(*log.notes, *notes), repairs=(*log.repairs, *notes)) if notes else log


def _typical_ranges(table: FrameTable, scans: Integers) -> NDArray[np.float64]:
    """What the beams read that see the robot itself [m], NaN for all others, (beams,); scans: of one beam pattern."""
    groups = _by_heading(table, scans)
    if len(groups) < MIN_SECTORS:
        return np.array([np.nan])
    readings = [np.stack([_hits(table, k) for k in group.tolist()]) for group in groups]
    whole = np.concatenate(readings)
    seen = np.isfinite(whole).mean(axis=0) >= MIN_SHARE
    median = np.full(whole.shape[1], np.inf)
    median[seen] = np.nanmedian(whole[:, seen], axis=0)
    share = np.mean([(np.abs(part - median) < TOLERANCE).mean(axis=0) for part in readings], axis=0)
    return np.where((median < MAX_REACH) & (share >= MIN_SHARE), median, np.nan)


def _by_heading(table: FrameTable, scans: Integers) -> list[Integers]:
    """Some scans for each sector of headings that was looked at often enough."""
    headings = table.odometry[table.scan_rows[scans], 2]
    sectors = np.floor(headings / (2.0 * math.pi) * SECTORS).astype(int) % SECTORS
    groups = [scans[sectors == sector] for sector in range(SECTORS)]
    return [
        group[np.unique(np.linspace(0, len(group) - 1, PER_SECTOR).astype(int))]
        for group in groups
        if len(group) >= MIN_PER_SECTOR
    ]


def _hits(table: FrameTable, scan: int) -> NDArray[np.float64]:
    """Readings of a scan [m], NaN for those that are no hits, (beams,)."""
    ranges = np.asarray(table.ranges[table.scan_starts[scan] : table.scan_starts[scan + 1]], dtype=np.float64)
    low, high = table.range_limits[scan].tolist()
    return np.where((ranges >= low) & (ranges > 0.0) & (ranges < high), ranges, np.nan)


def _without(table: FrameTable, scans: Integers, angles: NDArray[np.float64], own: NDArray[np.bool_]) -> FrameTable:
    """The table with the readings of some scans unknown where they look as the beams `own` of those at `angles` do."""
    begin, end = int(table.scan_starts[0]), int(table.scan_starts[-1])
    ranges = joined([table.ranges[at : min(at + PIECE, end)] for at in range(begin, end, PIECE)])
    starts = table.scan_starts - begin
    order = np.argsort(angles)
    masks = {
        k: np.interp(table.patterns[k].angles, angles[order], own[order].astype(float)) > 0.5
        for k in np.unique(table.scan_patterns[scans]).tolist()
    }
    for done, scan in enumerate(scans.tolist(), start=1):
        ranges[starts[scan] : starts[scan + 1]][masks[table.scan_patterns[scan]]] = np.nan
        if done % LET_GO == 0:
            forget_pages(ranges)
    return replace(table, ranges=ranges, scan_starts=starts)


def _directions(angles: NDArray[np.float64]) -> str:
    """Where beams look, such as `-27 to +26 deg`: from the first to the last of each bundle, of up to three."""
    angles = np.degrees(np.sort(angles))
    bundles = np.split(angles, np.flatnonzero(np.diff(angles) > BUNDLE_GAP) + 1)
    words = [f"{bundle[0]:+.0f} to {bundle[-1]:+.0f} deg" for bundle in bundles[:MAX_NAMED]]
    return ", ".join([*words, *(["…"] if len(bundles) > MAX_NAMED else [])])
