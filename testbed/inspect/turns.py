# SPDX-License-Identifier: MIT
"""How far the robot turns between scans, as the scans alone show it, and what that says of clocks and odometry.

Two scans taken shortly after each other differ mostly by a shift of their readings, which is the turn between them.
Turns from scans and from odometry are compared as functions of time: a constant shift in time is an offset of the
clocks, a factor is an odometry or a lidar that counts wrongly.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from testbed.formats.beams import even_spacing
from testbed.frame_table import Floats, FrameTable, Integers

MAX_TURN = math.radians(25.0)
"""Largest turn between two scans that is looked for [rad]."""
MAX_PERIOD = 0.5
"""Scans that are further apart in time are not compared [s]."""
BASELINE, BASELINE_TURN = 0.45, 0.8 * MAX_TURN
"""A scan is compared with the last one within so long [s] and so large a turn [rad]: a turn is seen with the same error
over any time, but a late clock shows in it by the change of the turn rate, which grows with the time. Of scans 0.1 s
apart, ten simulated drives show an offset to 4 ms (rms), of those 0.4 s apart to 1 ms."""
MAX_PAIRS = 600
"""Pairs of scans that are compared: those around which the turn rate changes most."""
BEAMS = 360
"""Beams of a scan that are compared; of more, evenly chosen ones."""
SECTORS, SECTOR_BEAMS = 8, 45
"""Scans whose beams were taken one after the other are compared in so many sectors of at least so many beams."""
CUT = 0.3
"""Readings that differ by more count as differing by this much [m]: at edges, or where somebody walks."""
MAX_OFFSETS, COARSE, FINE = (1.0, 3.0, 9.0), 0.02, 0.001
"""Offsets of the clocks are searched up to the first of these, or further where the best one is at the end, in steps of
the second and then of the third [s]."""
SMOOTHED = 9
"""Headings of odometry over so many times make one of those that are compared with a scan."""
CUT_TURN = math.radians(3.0)
"""Turns over 0.1 s that differ by more count as differing by this much [rad]; in the end those over any time."""
MIN_TURNED = math.radians(90.0)
"""The least that the robot must turn in all, without which nothing is said [rad]."""
MIN_PAIRS = 30
MAX_SCALE = 2.0
"""Turns by the scans of more than so many times those by odometry, or of less than its inverse, are other turns, such
as noise where a robot drives straight ahead: no offset makes one of the other."""


class Turns(NamedTuple):
    """Turns between scans."""

    begin: Floats
    """Time at which the middle beam of the first scan of each pair was taken [s], (n,)."""
    end: Floats
    """The same for the second scan, (n,)."""
    seen: Floats
    """Turn from the first to the second by the scans [rad], counter-clockwise, (n,)."""
    sweep: float
    """Time from the first to the last beam of a scan [s]: the turns are means over so long."""


class Clock(NamedTuple):
    """The offset between the clocks of scans and odometry, and how the turns compare."""

    offset: float
    """How much later the stamps of scans are than those of odometry [s]."""
    uncertainty: float
    """Standard deviation of the offset [s]."""
    scale: float
    """Turn by the scans for each radian turned by odometry."""
    scale_uncertainty: float
    """Standard deviation of the scale."""

    @property
    def is_off(self) -> bool:
        """Whether the offset is significant, and large enough to matter."""
        return abs(self.offset) > max(4.0 * self.uncertainty, MIN_OFFSET)


MIN_OFFSET = 0.03
"""A smaller offset does no harm [s]."""
SYSTEMATIC = 0.01
"""Standard deviation of what noise does not explain: wheels that count ticks, walls that are passed closely [s].
Simulated drives are wrong by a third of it (`python -m tools.measure.clock_offset`), recorded ones may be worse."""


def compare_turns(table: FrameTable) -> Clock | None:
    """Offset of the clocks and scale of the turns; None where the robot turns too little, or scans are too rare."""
    turns = _turns(table)
    stamps, first = np.unique(table.stamps, return_index=True)
    if turns is None or len(stamps) < 2:
        return None
    heading = np.unwrap(table.odometry[first, 2])
    # A mean over two periods: else poses between two stamps have less noise than those at one, and seem to fit best.
    # Not where odometry is as rare as scans, as in logs of CARMEN: there it would hide the turns themselves.
    mean_over, between = 2.0 * float(np.median(np.diff(stamps))), float(np.median(turns.end - turns.begin))
    width = max(turns.sweep, mean_over) if mean_over <= 1.01 * between else turns.sweep
    within = width * (np.arange(SMOOTHED) / (SMOOTHED - 1) - 0.5)[:, None]

    def by_odometry(offset: float) -> Floats:
        ends, begins = turns.end - offset + within, turns.begin - offset + within
        turned: Floats = (np.interp(ends, stamps, heading) - np.interp(begins, stamps, heading)).mean(axis=0)
        return turned

    if np.abs(by_odometry(0.0)).sum() < MIN_TURNED:
        return None
    offset, scale = 0.0, 1.0

    cut = CUT_TURN * max(between / 0.1, 1.0)  # wide while the scale is not known

    def misfit(offset: float) -> float:
        return float(np.minimum(np.abs(turns.seen - scale * by_odometry(offset)), cut).mean())

    for reach in MAX_OFFSETS:
        coarse = np.arange(-reach, reach + COARSE, COARSE)
        best = min(coarse.tolist(), key=misfit)
        if abs(best) < reach - COARSE:
            break
    else:
        return Clock(0.0, math.inf, *robust_scale(turns.seen, by_odometry(0.0)))
    for _ in range(2):  # the second time with the scale of the first
        best = min(coarse.tolist(), key=misfit)
        offset = min(np.arange(best - COARSE, best + COARSE + FINE, FINE).tolist(), key=misfit)
        scale, _ = robust_scale(turns.seen, by_odometry(offset))
        cut = CUT_TURN
    expected = by_odometry(offset)
    slope = scale * (by_odometry(offset + COARSE) - by_odometry(offset - COARSE)) / (2.0 * COARSE)
    rest = turns.seen - scale * expected
    near = np.abs(rest) < CUT_TURN
    if near.sum() < MIN_PAIRS or not 1.0 / MAX_SCALE < scale < MAX_SCALE:
        return Clock(0.0, math.inf, *robust_scale(turns.seen, by_odometry(0.0)))
    spread = 1.4826 * float(np.median(np.abs(rest[near] - np.median(rest[near]))))
    by_noise = spread / max(math.sqrt(float((slope[near] ** 2).sum())), 1e-9)
    return Clock(offset, math.hypot(by_noise, SYSTEMATIC), *robust_scale(turns.seen, expected))


def robust_scale(seen: Floats, expected: Floats) -> tuple[float, float]:
    """Turns by the scans for those by odometry, through zero, without outliers; and its standard deviation."""
    chosen = np.ones(len(seen), dtype=bool)
    scale = rest = 0.0
    for _ in range(5):
        energy = max(float((expected[chosen] ** 2).sum()), 1e-12)
        scale = float((seen[chosen] * expected[chosen]).sum()) / energy
        residuals = np.abs(seen - scale * expected)
        rest = 1.4826 * float(np.median(residuals[chosen]))
        chosen = residuals <= max(3.0 * rest, 1e-4)
    return scale, rest / math.sqrt(max(float((expected[chosen] ** 2).sum()), 1e-12))


def _turns(table: FrameTable) -> Turns | None:
    """Turns between scans of the lidar with the most scans."""
    if not len(table.scan_rows):
        return None
    scans = np.flatnonzero(table.scan_lidars == np.bincount(table.scan_lidars).argmax())
    firsts, seconds = scans[:-1], _partners(table, scans)
    begins, ends = table.stamps[table.scan_rows[firsts]], table.stamps[table.scan_rows[seconds]]
    alike = (table.readings[firsts] == table.readings[seconds]) & (ends > begins) & (ends - begins < MAX_PERIOD)
    alike &= np.isin(table.scan_patterns[firsts], _even(table)) & np.isin(table.scan_patterns[seconds], _even(table))
    pairs = _informative(table, np.flatnonzero(alike), begins)
    if len(pairs) < MIN_PAIRS:
        return None
    rows = [turn for k in pairs.tolist() for turn in _pair_turns(table, int(firsts[k]), int(seconds[k]))]
    begin, end, seen = np.array(rows).reshape(-1, 3).T
    known = np.isfinite(seen)
    if known.sum() < MIN_PAIRS:
        return None
    times = table.patterns[table.scan_patterns[firsts[pairs[0]]]].time_offsets
    sweep = 0.0 if times is None else float(np.ptp(times)) * len(pairs) / len(rows)
    return Turns(begin[known], end[known], seen[known], sweep)


def _partners(table: FrameTable, scans: Integers) -> Integers:
    """The scan that each of the scans (n,) but the last is compared with, (n - 1,): the last one within `BASELINE`, but
    at least the next one."""
    stamps, headings = table.stamps[table.scan_rows[scans]], np.unwrap(table.odometry[table.scan_rows[scans], 2])
    partners = np.arange(1, len(scans))
    for step in range(2, len(scans)):
        apart = stamps[step:] - stamps[:-step]
        near = (apart <= BASELINE) & (np.abs(headings[step:] - headings[:-step]) <= BASELINE_TURN)
        partners[: len(near)][near] = np.arange(step, len(scans))[near]
        if not (apart <= BASELINE).any():
            break
    chosen: Integers = scans[partners]
    return chosen


def _even(table: FrameTable) -> Integers:
    """Numbers of the patterns with evenly spaced beams."""
    return np.array([k for k, p in enumerate(table.patterns) if p.angles.size > MIN_PAIRS and even_spacing(p.angles)])


def _informative(table: FrameTable, pairs: Integers, begins: Floats) -> Integers:
    """The pairs within a second of the largest changes of the turn rate by odometry."""
    if len(pairs) <= MAX_PAIRS:
        return pairs
    stamps, first = np.unique(table.stamps, return_index=True)
    heading = np.unwrap(table.odometry[first, 2])
    rates = np.diff(np.interp(np.stack([begins[pairs] + d for d in (-0.2, 0.0, 0.2)]), stamps, heading), axis=0)
    change, chosen = np.abs(rates[1] - rates[0]), np.zeros(len(pairs), dtype=bool)
    for k in np.argsort(-change).tolist():
        chosen |= np.abs(begins[pairs] - begins[pairs[k]]) <= MAX_OFFSETS[0]
        if chosen.sum() >= MAX_PAIRS:
            break
    return pairs[chosen]


def _pair_turns(table: FrameTable, first: int, second: int) -> list[tuple[float, float, float]]:
    """Turns from one scan to the next, as rows of `Turns`; of scans whose beams have times, those of each sector: where
    the robot begins or ends a turn, each sector sees another part of it."""
    pattern = table.patterns[table.scan_patterns[first]]
    every = max(pattern.angles.size // BEAMS, 1)
    step = float(pattern.angles[every] - pattern.angles[0])
    times = np.zeros(pattern.angles.size) if pattern.time_offsets is None else pattern.time_offsets
    times = times[::every]
    a, b = (_profile(table, scan) for scan in (first, second))
    a, b = _moved(table, first, second, a, pattern.angles)[::every], b[::every]
    reach = min(int(MAX_TURN / abs(step)), len(a) // 3)
    stamps = table.stamps[table.scan_rows[[first, second]]]
    if len(a) * abs(step) > 2.0 * math.pi - 1.5 * abs(step):
        a = np.concatenate([a[-reach:], a, a[:reach]])
    else:
        b, times = b[reach : len(b) - reach], times[reach : len(b) - reach]
    count = max(min(SECTORS, len(b) // SECTOR_BEAMS), 1) if np.ptp(times) > 0.0 else 1
    edges = np.linspace(0, len(b), count + 1).astype(int).tolist()
    found = []
    for low, high in pairwise(edges):
        shift = _shift(a[low : high + 2 * reach], b[low:high])
        middle, turned = float(times[low:high].mean()), shift - reach
        # the first scan saw the same walls by other beams, which were taken earlier or later
        before = 0.0 if math.isnan(turned) else turned * float(np.median(np.diff(times)))
        found.append((float(stamps[0]) + middle + before, float(stamps[1]) + middle, turned * step))
    return found


def _shift(a: Floats, b: Floats) -> float:
    """Where readings b (n,) [m] fit best into the longer a, in beams from its begin; NaN where they have little in
    common, or fit best at an end."""
    apart = np.abs(np.lib.stride_tricks.sliding_window_view(a, len(b)) - b)
    known = np.isfinite(apart)
    counts = known.sum(axis=1)
    if counts.min() < MIN_PAIRS:
        return math.nan
    cost = np.where(known, np.minimum(apart, CUT), 0.0).sum(axis=1) / counts
    k = int(np.argmin(cost))
    if k in (0, len(cost) - 1):
        return math.nan
    low, least, high = cost[k - 1 : k + 2].tolist()
    curve = low - 2.0 * least + high
    return k + (0.5 * (low - high) / curve if curve > 0.0 else 0.0)


def _moved(table: FrameTable, first: int, second: int, ranges: Floats, angles: Floats) -> Floats:
    """Readings (n,) [m] of the first scan as they were if the lidar had moved to the place of the second by odometry,
    without turning."""
    x, y, _ = se2.between(*(se2.compose(table.odometry[table.scan_rows[k]], table.mounts[k]) for k in (first, second)))
    px, py = ranges * np.cos(angles) - x, ranges * np.sin(angles) - y
    turned = np.arctan2(py, px) - angles
    at = angles + turned - 2.0 * math.pi * np.round(turned / (2.0 * math.pi))
    known = np.isfinite(at)
    if known.sum() < MIN_PAIRS:
        return ranges
    order = np.argsort(at[known])
    moved: Floats = np.interp(angles, at[known][order], np.hypot(px, py)[known][order])
    return np.where(known, moved, np.nan)


def _profile(table: FrameTable, scan: int) -> NDArray[np.float64]:
    """Readings of a scan [m], NaN where they are no hit."""
    ranges = np.asarray(table.ranges[table.scan_starts[scan] : table.scan_starts[scan + 1]], dtype=np.float64)
    low, high = table.range_limits[scan].tolist()
    return np.where((ranges > 0.0) & (ranges >= low) & (ranges < high), ranges, np.nan)
