# SPDX-License-Identifier: MIT
"""Lidars that send a turn in several scans, each of which looks elsewhere.

The filter takes the newest scan of each lidar at an update. So each segment counts as a lidar of its own: else it would
see one segment only.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from testbed.formats import Log
from testbed.frame_table import FrameTable, Integers

MAX_SEGMENTS = 40
MIN_EACH = 0.5
"""Each segment comes at least so many times as often as if all came equally often."""
MIN_TURNS = 0.9
"""So large a share of the scans look elsewhere than the one before."""


def with_segments_apart(log: Log) -> Log:
    """The log with a lidar for each segment, with a note; the log itself where no lidar sends segments."""
    table, notes = log.table, []
    for lidar, name in enumerate(log.table.lidars):
        scans = np.flatnonzero(table.scan_lidars == lidar)
        segments = _segments(table, scans)
        if len(segments) < 2:
            continue
        named = [f"{name}_{number}" for number in range(1, len(segments) + 1)]
        lidars, of = table.scan_lidars.copy(), table.scan_patterns[scans]
        for number, pattern in enumerate(segments.tolist()):
            lidars[scans[of == pattern]] = lidar if number == 0 else len(table.lidars) + number - 1
        names = [*table.lidars, *named[1:]]
        names[lidar] = named[0]
        table = replace(table, scan_lidars=lidars, lidars=tuple(names))
        notes.append(
            f"scans of {name or 'the lidar'} look in {len(segments)} directions by turns, as segments of a turn: "
            "each counts as a lidar of its own"
        )
    return replace(log, table=table, notes=(*log.notes, *notes), repairs=(*log.repairs, *notes)) if notes else log


def _segments(table: FrameTable, scans: Integers) -> Integers:
    """Beam patterns of the segments of a turn, in the order of their directions; none where scans are no segments."""
    own = table.scan_patterns[scans]
    patterns, counts = np.unique(own, return_counts=True)
    none = np.empty(0, dtype=np.int64)
    if not 2 <= len(patterns) <= MAX_SEGMENTS or counts.min() < MIN_EACH * len(scans) / len(patterns):
        return none
    if any(table.patterns[k].angles.size < 2 for k in patterns.tolist()) or np.mean(np.diff(own) != 0) < MIN_TURNS:
        return none
    low, high = (np.array([f(table.patterns[k].angles) for k in patterns.tolist()]) for f in (np.min, np.max))
    order = np.argsort(low)
    apart: Integers = patterns[order]
    return apart if (low[order][1:] > high[order][:-1]).all() else none
