# SPDX-License-Identifier: MIT
"""A constant offset between the clocks of scans and odometry, taken back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from testbed.formats import Log
from testbed.formats.pose_interpolation import interpolate
from testbed.frame_table import Floats, FrameTable
from testbed.inspect.turns import Clock, compare_turns

SAME_TIME = 1e-6
"""Frames that are closer in time [s] are one."""
MAX_OFFSET = 3600.0
"""A larger offset is another recording [s]."""


def parse_time_offset(text: str) -> float | None:
    """Return the seconds that a text states, None for `auto`; ValueError for anything else."""
    if text == "auto":
        return None
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not abs(seconds) <= MAX_OFFSET:
        raise ValueError(f"--time-offset {text}: expected auto, or seconds from {-MAX_OFFSET:g} to {MAX_OFFSET:g}")
    return seconds


def without_time_offset(log: Log, seconds: float | None) -> Log:
    """Return a log whose scans are stamped by the clock of the odometry, with a note.

    seconds: how much later the stamps of scans are; None = it is estimated, and taken back where it is significant
    """
    if seconds is None:
        clock = estimate_offset(log.table)
        if clock is None or not math.isfinite(clock.uncertainty):
            note = "the offset of the clocks cannot be estimated: the robot turns too little, or scans are too rare"
            return replace(log, notes=(*log.notes, note))
        estimate = f"{clock.offset:+.3f} ± {clock.uncertainty:.3f} s"
        if not clock.is_off:
            note = f"scans are {estimate} late against the odometry: not significant, nothing is changed"
            return replace(log, notes=(*log.notes, note))
        seconds, note = clock.offset, f"scans are {estimate} late against the odometry: taken back"
    else:
        note = f"scans are {seconds:+g} s late against the odometry (as given): taken back"
    table, lost = shifted(log.table, seconds)
    note += f"; {lost} scans lie outside of the odometry's time and are left out" if lost else ""
    return replace(log, table=table, notes=(*log.notes, note), repairs=(*log.repairs, note))


def estimate_offset(table: FrameTable) -> Clock | None:
    """The offset of the clocks, estimated again where it is off: then the motion between two scans, by which they are
    compared, is that of their time."""
    clock = compare_turns(table)
    if clock is None or not math.isfinite(clock.uncertainty) or not clock.is_off:
        return clock
    rest = compare_turns(shifted(table, clock.offset)[0])
    if rest is None or not math.isfinite(rest.uncertainty):
        return clock
    return rest._replace(offset=clock.offset + rest.offset)


def shifted(table: FrameTable, seconds: float) -> tuple[FrameTable, int]:
    """Frames whose scans are stamped so much earlier, in the order of time, and how many scans lie outside.

    Odometry and truth of a scan are interpolated at its new stamp; those at its old stamp become a frame of their own.
    Raises ValueError where no scan is left.
    """
    stamps, first = np.unique(table.stamps, return_index=True)
    new = table.stamps[table.scan_rows] - seconds
    kept = np.flatnonzero((new >= stamps[0]) & (new <= stamps[-1]))
    kept = kept[np.argsort(new[kept], kind="stable")]
    if not len(kept):
        raise ValueError(f"time offset {seconds:g} s: no scan is left within the odometry's time")
    nearest = np.clip(np.searchsorted(new[kept], stamps), 1, max(len(kept) - 1, 1))
    apart = np.abs(new[kept][[nearest - 1, np.minimum(nearest, len(kept) - 1)]] - stamps).min(axis=0)
    alone = first[apart > SAME_TIME]
    everything = np.concatenate([table.stamps[alone], new[kept]])
    order = np.argsort(everything, kind="stable")
    rows = np.empty(len(order), dtype=np.int64)
    rows[order] = np.arange(len(order))
    at_scans = np.clip(np.searchsorted(stamps, new[kept]), 0, len(stamps) - 1)

    def merged(column: Floats, moved: Floats) -> Floats:
        values: Floats = np.concatenate([column[alone], moved])[order]
        return values

    def held(column: Floats) -> Floats:
        return merged(column, column[first][at_scans])

    pieces = [np.arange(table.scan_starts[k], table.scan_starts[k + 1]) for k in kept.tolist()]
    return replace(
        table,
        stamps=everything[order],
        odometry=merged(table.odometry, interpolate(stamps, table.odometry[first], new[kept])),
        truth=merged(table.truth, interpolate(stamps, table.truth[first], new[kept])),
        twist=held(table.twist),
        command=held(table.command),
        scan_rows=rows[len(alone) :],
        scan_lidars=table.scan_lidars[kept],
        scan_patterns=table.scan_patterns[kept],
        scan_starts=np.cumsum([0, *map(len, pieces)], dtype=np.int64),
        ranges=table.ranges[np.concatenate(pieces)],
        range_limits=table.range_limits[kept],
        mounts=table.mounts[kept],
    ), len(table.scan_rows) - len(kept)
