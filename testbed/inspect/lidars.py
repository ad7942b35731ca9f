# SPDX-License-Identifier: MIT
"""Mount, beams, readings and limits of the lidars of a recording."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from testbed.formats.beams import even_spacing
from testbed.frame_table import Floats, FrameTable, Integers
from testbed.inspect.finding import Finding
from testbed.inspect.times import scans_of
from testbed.large_arrays import forget_pages
from testbed.weak_sensors import shortcomings, view_of

MAX_TYPICAL = 60.0
"""Median of the hits [m] from which on they are hardly metres."""
MIN_HITS = 0.05
"""Share of the readings that are hits, below which there is next to nothing to map."""
NEARER_SHARE, FARTHER_SHARE, TOO_NEAR = 0.1, 0.03, 0.02
"""Shares of readings beyond the limits of the lidar that are doubtful; what is nearer [m] is none."""
CLUSTER_SHARE, CLUSTER_TOP = 0.03, 0.95
"""One value with at least this share of all hits, and beyond this share of the largest one, is none."""


def inspect_lidars(table: FrameTable) -> Iterator[Finding]:
    """What each lidar is and sees."""
    for lidar, name in enumerate(table.lidars):
        scans = scans_of(table, lidar)
        if len(scans):
            yield _mount(table, name, scans)
            yield _beams(table, name, scans)
            yield from _readings(table, name, scans)
            if _take_turns(table, scans):
                found = "each differs from the one before, and is like the one before that"
                yield Finding(f"views of {name}", found, "doubtful", "used as they are: two lidars with one frame?")


def _mount(table: FrameTable, name: str, scans: Integers) -> Finding:
    x, y, theta = table.mounts[scans[0]].tolist()
    varies = bool(np.ptp(table.mounts[scans], axis=0).max() > 1e-3)
    found = f"({x:+.3f}, {y:+.3f}) m, {math.degrees(theta):+.1f} deg from the robot's centre"
    if varies:
        return Finding(f"mount of {name}", f"{found}; it changes", "doubtful", "used as each scan states it")
    return Finding(f"mount of {name}", found, action="used; --laser-offset X says otherwise")


def _beams(table: FrameTable, name: str, scans: Integers) -> Finding:
    """Number and directions of the beams, and whether they can carry a map."""
    counts = table.readings[scans]
    pattern = table.patterns[table.scan_patterns[scans[np.argmax(counts)]]]
    low, high = table.range_limits[scans[0]].tolist()
    count = f"{counts.min()} beams" if counts.min() == counts.max() else f"{counts.min()} to {counts.max()} beams"
    spacing = even_spacing(pattern.angles)
    view = view_of(pattern.angles)
    way = "unevenly spaced" if spacing is None else f"every {math.degrees(abs(spacing[1])):.2f} deg"
    way += ", clockwise" if spacing is not None and spacing[1] < 0.0 else ""
    times = (
        ""
        if pattern.time_offsets is None or not pattern.angles.size
        else f", taken within {np.ptp(pattern.time_offsets):.3f} s"
    )
    limits = f"{low:g} m to {'any range' if math.isinf(high) else f'{high:g} m'}"
    found = f"{count} over {math.degrees(min(view, 2.0 * math.pi)):.0f} deg, {way}{times}; hits from {limits}"
    short = shortcomings(view, int(np.median(counts)), high)
    if short:
        found += f": {' and '.join(short)}"
        return Finding(f"beams of {name}", found, "doubtful", "such a sensor can hardly carry a map: compare odometry")
    return Finding(f"beams of {name}", found)


def _readings(table: FrameTable, name: str, scans: Integers) -> Iterator[Finding]:
    """Shares of hits, no returns, invalid readings; values that are no range."""
    owner = np.repeat(_some(scans), table.readings[_some(scans)])
    ranges, limits = _ranges_of(table, _some(scans)), table.range_limits[owner]
    if not ranges.size:
        yield Finding(f"readings of {name}", "none: all scans are empty", "doubtful")
        return
    hit = (ranges >= limits[:, 0]) & (ranges > 0.0) & (ranges < limits[:, 1])
    shares = {
        "hits": hit,
        "no return": ranges >= limits[:, 1],
        "lost (NaN)": np.isnan(ranges),
        "too near or zero": ~hit & (ranges < limits[:, 1]),
    }
    found = ", ".join(f"{words} {np.mean(of):.1%}" for words, of in shares.items() if of.any())
    few = np.mean(hit) < MIN_HITS
    action = "too few hits for a map" if few else "used as it is"
    yield Finding(f"readings of {name}", found, "doubtful" if few else "ok", action)
    if not hit.any():
        return
    yield from _beyond_limits(ranges, limits, name)
    typical = float(np.median(ranges[hit]))
    if typical > MAX_TYPICAL:
        found = f"the median hit is at {typical:g} m"
        yield Finding(f"unit of {name}", found, "doubtful", "used as it is: are these centimetres or millimetres?")
    values, counts = np.unique(ranges[hit], return_counts=True)
    most = int(np.argmax(counts))
    if counts[most] > CLUSTER_SHARE * hit.sum() and values[most] > CLUSTER_TOP * values[-1] and len(values) > 1:
        found = f"{counts[most] / ranges.size:.1%} of all readings are {values[most]:g} m, near the largest"
        action = f"they count as hits; --range-max {values[most]:g} makes them no returns"
        yield Finding(f"no return of {name}", found, "doubtful", action)


def _beyond_limits(ranges: Floats, limits: Floats, name: str) -> Iterator[Finding]:
    """Readings (n,) that look like measured ones, but lie beyond the limits (n, 2) that the recording states [m]."""
    sides = {
        "nearer than the smallest range": ((ranges > TOO_NEAR) & (ranges < limits[:, 0]), 0, NEARER_SHARE),
        "farther than the largest range": ((ranges > limits[:, 1]) & (ranges < MAX_TYPICAL), 1, FARTHER_SHARE),
    }
    for words, (beyond, side, most) in sides.items():
        values, counts = np.unique(np.round(ranges[beyond], 2), return_counts=True)
        measured = counts.sum() - counts.max(initial=0)  # one value is a driver's way to say "nothing"
        if measured > most * ranges.size:
            found = f"{measured / ranges.size:.1%} of all are {words} stated, {np.median(limits[:, side]):g} m: "
            found += f"{values[0]:g} to {values[-1]:g} m"
            action = "they count as " + ("lost" if side == 0 else "no returns; --range-max R says otherwise")
            yield Finding(f"limits of {name}", found, "doubtful", action)


def _ranges_of(table: FrameTable, scans: Integers) -> Floats:
    """Readings of some scans, one after the other [m]; those in files are let go of as they are read, since the system
    brings in what lies around each."""
    parts = [np.empty(0)]
    for done, k in enumerate(scans.tolist(), start=1):
        parts.append(table.ranges[table.scan_starts[k] : table.scan_starts[k + 1]].astype(np.float64))
        if done % LET_GO == 0:
            forget_pages(table.ranges)
    return np.concatenate(parts)


def _take_turns(table: FrameTable, scans: Integers) -> bool:
    """Whether most scans are like the last but one and unlike the last, as where two lidars send under one name."""
    likes = []
    for k in np.unique(np.linspace(0, len(scans) - 3, TRIPLES).astype(int)) if len(scans) >= MIN_TRIPLES else ():
        three = [table.ranges[table.scan_starts[n] : table.scan_starts[n + 1]] for n in scans[k : k + 3]]
        if len({len(ranges) for ranges in three}) == 1 and len(three[0]):
            first, second, third = (np.where(np.isfinite(ranges), ranges, 0.0) for ranges in three)
            last, last_but_one = np.mean(np.abs(third - second)), np.mean(np.abs(third - first))
            likes.append(last > UNLIKE * last_but_one + STEADY)
        forget_pages(table.ranges)
    return len(likes) > 0 and float(np.mean(likes)) > 0.5


TRIPLES, MIN_TRIPLES = 100, 20
"""Scans that are compared with the two before them; of fewer scans nothing is said."""
UNLIKE, STEADY = 3.0, 0.05
"""A scan that differs so many times as much from the last one as from the last but one, and by this more [m], is of
another view."""
LET_GO = 16
"""Scans that are read before the memory of their file is let go of."""
MAX_SCANS = 500
"""Scans whose readings are looked at; of more, evenly chosen ones."""


def _some(scans: Integers) -> Integers:
    chosen: Integers = scans[np.unique(np.linspace(0, len(scans) - 1, min(len(scans), MAX_SCANS)).astype(int))]
    return chosen
