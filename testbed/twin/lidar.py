# SPDX-License-Identifier: MIT
"""The lidar of a log as a preset of the simulator: field of view, beams, rate, ranges, noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.motion.continuous_odometry import has_jumped
from testbed.formats import LogError
from testbed.frame_table import FrameTable
from testbed.presets import LidarPreset, Mount

Floats = NDArray[np.float64]

RANGE_STEPS = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
"""Steps to which ranges may be rounded, largest first [m]."""
MAX_BEND = 0.08
"""Three neighbouring readings that are off a line by more than this are no wall [m]."""
MAX_RANGE_RATIO = 1.1
"""Largest ratio of neighbouring ranges on a wall; at flatter angles the roughness of a wall counts as noise."""
MAX_SCANS = 1000
"""Readings are taken from this many scans, spread over the log."""
STILL = 1e-3
"""A robot whose odometry moves by less than this along each axis stands still [m, m, rad]."""
MIN_AT_REST = 20
"""With fewer pairs of scans at rest the noise is taken from how straight walls look."""
NOISE_BINS = 8
"""Groups of ranges, near to far, whose noise is compared."""
_SOURCE = "estimated from the log"


@dataclass(frozen=True, kw_only=True)
class TwinLidar:
    """A lidar that scans as that of a log."""

    preset: LidarPreset
    mount: Mount
    """Its mount, turned so that the field of view is symmetric to its forward direction."""
    sweeps: bool
    """Whether beams are measured one after the other, at the times that the log states."""
    scans: NDArray[np.int64]
    """Numbers of its scans in the log, (m,)."""
    notes: tuple[str, ...]
    """What of the log's lidars the twin does not have."""


def estimate_lidar(table: FrameTable) -> TwinLidar:
    """Estimate the lidar with the most scans of a log. Raises LogError where its scans have fewer than two beams."""
    lidar = int(np.argmax(np.bincount(table.scan_lidars)))
    scans = np.flatnonzero(table.scan_lidars == lidar)
    number = int(np.argmax(np.bincount(table.scan_patterns[scans])))
    pattern = table.patterns[number]
    scans = scans[table.scan_patterns[scans] == number]
    beams = pattern.angles.size
    if beams < 2:
        raise LogError("scans of fewer than two beams, expected a lidar with a field of view")
    angles = np.sort(pattern.angles)
    step = float(np.median(np.diff(angles)))
    view, middle = float(angles[-1] - angles[0]), 0.5 * float(angles[0] + angles[-1])
    if abs(view + step - 2.0 * math.pi) < 0.5 * step:  # a full turn: the last beam lies one step before the first
        view, middle = 2.0 * math.pi, float(angles[0]) + math.pi
    sample = scans[:: max(1, len(scans) // MAX_SCANS)]
    ranges: Floats = np.stack([np.asarray(table.scan(k).ranges) for k in sample.tolist()])
    range_min, range_max = table.range_limits[scans[0]].tolist()
    hits = (ranges >= range_min) & (ranges > 0.0) & (ranges < range_max)
    lost = np.isnan(ranges) | (ranges <= 0.0)
    range_step = _range_step(ranges[hits])
    order = np.argsort(pattern.angles)
    at_rest = _differences_at_rest(table, scans)
    if at_rest is None:
        at_rest = _bends(np.where(hits, ranges, np.nan)[:, order], step)
    floor, share = _noise(*at_rest, range_step)
    values: dict[str, Any] = {
        "beams": beams,
        "field_of_view_deg": min(round(math.degrees(view), 6), 360.0),
        "scan_rate": _rate(table, scans),
        **_times(table.stamps[table.scan_rows[scans]] - table.stamps[0]),
        "range_min": max(range_min, 0.0),
        "range_max": range_max if math.isfinite(range_max) else float(np.max(ranges[hits], initial=1.0)) + 1.0,
        "noise_floor": floor,
        "noise_share": share,
        "range_step": range_step,
        "dropout": float(np.mean(lost)),
    }
    preset = LidarPreset(name="twin_lidar", title="Lidar of a log", sources=dict.fromkeys(values, _SOURCE), **values)
    x, y, theta = table.mounts[scans[0]].tolist()
    mount = Mount(x=x, y=y, theta_deg=math.degrees(math.remainder(theta + middle, 2.0 * math.pi)))
    return TwinLidar(
        preset=preset,
        mount=mount,
        sweeps=_sweeps(pattern.time_offsets, preset.sweep_time),
        scans=scans,
        notes=_notes(table, lidar, len(scans), angles, step),
    )


def _sweeps(time_offsets: Floats | None, sweep_time: float) -> bool:
    """Tell whether the times of beams are those of a lidar that turns once in each scan, to a fifth."""
    if time_offsets is None:
        return False
    return abs(float(np.ptp(time_offsets)) - sweep_time) < 0.2 * sweep_time


def _notes(table: FrameTable, lidar: int, scans: int, angles: Floats, step: float) -> tuple[str, ...]:
    notes = []
    if len(table.lidars) > 1:
        others = ", ".join(name for k, name in enumerate(table.lidars) if k != lidar)
        notes.append(f"the twin has one lidar, {table.lidars[lidar]}: {others} left out")
    if (different := int((table.scan_lidars == lidar).sum()) - scans) > 0:
        notes.append(f"{different} scans have other beams than the twin's lidar")
    if np.abs(np.diff(angles) - step).max() > 0.1 * step:
        notes.append("the beams of the log are not evenly spaced, those of the twin are")
    return tuple(notes)


def _times(stamps: Floats) -> dict[str, tuple[float, ...]]:
    """Return the times of the scans as a setting, from their stamps (n,) after the beginning of the log [s].

    Nothing where stamps step back or come in bursts, as on Intel: they do not tell when the scans were taken.
    """
    times = stamps.round(6)
    return {"scan_times": tuple(times.tolist())} if times[0] >= 0.0 and (np.diff(times) > 0.0).all() else {}


def _rate(table: FrameTable, scans: NDArray[np.int64]) -> float:
    """Return how many scans a second there are [Hz] while the robot moves: many logs leave them out where it stands."""
    rows = table.scan_rows[scans]
    seconds, steps = np.diff(table.stamps[rows]), se2.between(table.odometry[rows[:-1]], table.odometry[rows[1:]])
    moved = np.where(has_jumped(steps, seconds), 0.0, np.hypot(steps[:, 0], steps[:, 1]) + np.abs(steps[:, 2]))
    order = np.argsort(seconds)
    share = np.cumsum((moved * (seconds > 0.0))[order])
    if share.size == 0 or share[-1] == 0.0:
        return 1.0 / max(float(np.median(seconds)) if seconds.size else 1.0, 1e-3)
    middle = order[np.searchsorted(share, 0.5 * share[-1])]
    return 1.0 / max(float(seconds[middle]), 1e-3)


def _range_step(ranges: Floats) -> float:
    """Return the largest step of which nearly all ranges (n,) are multiples [m]; 0 = none."""
    sample = ranges[:: max(1, ranges.size // 20_000)]
    for step in RANGE_STEPS:
        if sample.size and np.mean(np.abs(sample - step * np.round(sample / step)) < 1e-4) > 0.99:
            return step
    return 0.0


def _differences_at_rest(table: FrameTable, scans: NDArray[np.int64]) -> tuple[Floats, Floats] | None:
    """Return ranges and errors (n,) [m] of readings, from pairs of scans between which the robot did not move.

    Two readings of one beam differ by sqrt(2) times the noise, whatever the wall is like. None where there are fewer
    than `MIN_AT_REST` pairs.
    """
    rows = table.scan_rows[scans]
    steps = np.abs(se2.between(table.odometry[rows[:-1]], table.odometry[rows[1:]]))
    pairs = np.flatnonzero((steps < STILL).all(axis=1))
    if len(pairs) < MIN_AT_REST:
        return None
    pairs = pairs[:: max(1, len(pairs) // MAX_SCANS)]
    high = float(table.range_limits[scans[0], 1])
    one, other = (np.stack([np.asarray(table.scan(k).ranges) for k in scans[pairs + d].tolist()]) for d in (0, 1))
    hits = (one > 0.0) & (one < high) & (other > 0.0) & (other < high)
    errors, middle = ((other - one)[hits] / math.sqrt(2.0), 0.5 * (one + other)[hits])
    same = np.abs(errors) < MAX_BEND  # else a beam that met an edge, or somebody walked by
    return middle[same], errors[same]


def _bends(ranges: Floats, step: float) -> tuple[Floats, Floats]:
    """Return ranges and errors (n,) [m] of readings on straight walls, from scans (n, beams) with NaN for none.

    On a straight wall the inverse ranges of three neighbouring beams satisfy 1/a + 1/c = 2 cos(step) / b, whatever its
    direction; b differs by its own noise and half the variance of a and c. A rough wall counts as noise.
    """
    a, b, c = ranges[:, :-2], ranges[:, 1:-1], ranges[:, 2:]
    bend = b - 2.0 * np.cos(step) / (1.0 / a + 1.0 / c)
    wall = (np.abs(bend) < MAX_BEND) & (np.maximum(a, c) < MAX_RANGE_RATIO * np.minimum(a, c))
    return b[wall], bend[wall] / math.sqrt(1.5)


def _noise(ranges: Floats, errors: Floats, range_step: float) -> tuple[float, float]:
    """Return the noise of short ranges [m] and that of long ones as a share, from readings and their errors (n,)."""
    if errors.size < 10 * NOISE_BINS:
        return range_step, 0.0
    bins = np.array_split(np.argsort(ranges), NOISE_BINS)
    middle = np.array([np.median(ranges[rows]) for rows in bins])
    sigma = np.array([_deviation(errors[rows]) for rows in bins])
    sigma = np.sqrt(np.maximum(sigma**2 - range_step**2 / 12.0, 1e-8))
    return _floor_and_share(middle, sigma)


def _deviation(values: Floats) -> float:
    """Return the standard deviation of values (n,) without those beyond three of it; edges of things are no noise."""
    kept = values
    for _ in range(10):
        kept = kept[np.abs(kept) < 3.0 * max(float(np.std(kept)), 1e-6)]
    return float(np.std(kept)) / 0.9866 if kept.size else 0.0  # of a Gaussian cut at three standard deviations


def _floor_and_share(ranges: Floats, sigma: Floats) -> tuple[float, float]:
    """Fit noise (n,) by max(floor, share * range), the near groups by the one, the far ones by the other."""
    best, found = np.inf, (float(np.median(sigma)), 0.0)
    for k in range(1, len(ranges) + 1):
        floor = float(np.median(sigma[:k]))
        share = float(np.median(sigma[k:] / ranges[k:])) if k < len(ranges) else 0.0
        error = float(np.sum(np.log(sigma / np.maximum(floor, share * ranges)) ** 2)) + 0.02 * (share > 0.0)
        if error < best:
            best, found = error, (floor, min(share, 1.0))
    return found
