# SPDX-License-Identifier: MIT
"""Stamps of a topic that are no times of the recording, found and mended by the bag's own times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.motion.continuous_odometry import has_jumped
from testbed.formats.ros.reading.content import BagContent
from testbed.formats.ros.reading.decode import Track, seconds
from testbed.formats.ros.reading.raw_scans import RawScans

Floats = NDArray[np.float64]

MIN_LOOP = 1.0
"""Stamps that step back by more than this [s] mean that a recording begins again, even if only for a message."""
MIN_STEP_BACK = 0.1
"""A clock that is set back by less [s] does little harm: messages of a topic may also come in another order."""
BEGIN_SHARE = 0.1
"""Stamps that step back into this first share of what was recorded so far begin again; else the clock was set back."""
REGULAR = 0.6
"""Stamps that come at one rate are no nearer to each other than this share of the usual gap."""
NEIGHBOURS, FAR = 2, 5.0
"""A stamp that is further from the median of so many on each side than so many usual periods, and than `MIN_LOOP`, is
a stray."""
MAX_FRACTION = 1.01e-3
"""Stamps whose fractions of a second all lie below this count micro- or milliseconds where nanoseconds belong."""
UNITS = ((1e3, "milliseconds"), (1e6, "microseconds"))
"""Stamps that run so many times as fast as the bag's times count in these units instead of seconds."""
MAX_RATE_ERROR = 0.2
"""They run so fast up to this share."""
MIN_STAMPS = 10
"""Of fewer stamps nothing can be said of their fractions and their rate."""


def one_clock(content: BagContent, times: Floats, track: Track) -> Track:
    """Odometry without repeated passes, with the bag's `times` [s], (n,), where its stamps are none."""
    moving = np.append(True, (np.diff(track.poses, axis=0) != 0.0).any(axis=1))  # a pose may well be sent twice
    fault = _fault(track.stamps[moving], times[moving])
    if fault is None and len(track.stamps) and np.ptp(track.stamps) == 0.0:
        fault = _fault(track.stamps, times)
    if fault is not None:
        content.notes.append(f"{fault.format('the odometry')}: the bag's own times are used")
        track = track._replace(stamps=times)
    else:
        track = track._replace(stamps=_without_zeros(content, track.stamps, times, "the odometry"))
        content.clock_offset = _lag(track.stamps, times)
    kept = ~_strays(content, track.stamps, "the odometry")
    track, times = track.chosen(kept), times[kept]
    steps = _steps_back(track.stamps, times)
    if steps and not _begins_again(track.stamps, steps) and _goes_on(track.poses, times, steps):
        return track._replace(stamps=_joined(content, track.stamps, times, steps, "the odometry"))
    count = first_pass(track.stamps)
    if count < len(track.stamps):
        content.notes.append(
            f"time steps back by {track.stamps[:count].max() - track.stamps[count]:.1f} s: the recording was played "
            f"more than once; the first pass is used, {len(track.stamps) - count} messages of odometry are left out"
        )
    return track.first(count)


def in_one_pass(content: BagContent, nanoseconds: Sequence[int], scans: RawScans) -> RawScans:
    """Scans of a topic without repeated passes, by the times of the bag where their stamps are none.

    nanoseconds: times of the bag [ns]
    """
    stamps = scans.stamps
    times = np.array([seconds(time) for time in nanoseconds])
    fault = _fault(stamps, times)
    if fault is not None:
        content.notes.append(f"{fault.format('the scans')}: the bag's own times are used")
        stamps = times - content.clock_offset
    else:
        stamps = _without_zeros(content, stamps, times, "the scans")
    content.scan_clock_offset = _lag(stamps, times)
    kept = np.flatnonzero(~_repeated(scans, stamps))
    if len(kept) < len(scans):
        content.notes.append(f"{len(scans) - len(kept)} scans are in the bag twice: one of each two is left out")
    kept = kept[~_strays(content, stamps[kept], "scans")]
    stamps = stamps.copy()
    stamps[kept] = _on_one_clock(content, stamps[kept], times[kept], "the scans")
    count = first_pass(stamps[kept])
    if count < len(kept):
        content.notes.append(f"{len(kept) - count} scans from where their time steps back on are left out")
    kept = kept[:count]
    scans = scans.at(stamps)
    return scans if len(kept) == len(scans) else scans.chosen(kept)


def true_path(content: BagContent, times: Floats, track: Track) -> Track:
    """True poses without repeated passes, with the bag's `times` [s], (n,), where their stamps are none."""
    fault = _fault(track.stamps, times)
    if fault is not None:
        content.notes.append(f"{fault.format('the truth')}: the bag's own times are used")
    stamps = times - content.clock_offset if fault is not None else track.stamps
    track = track._replace(stamps=_on_one_clock(content, stamps, times, "the truth"))
    return track.first(first_pass(track.stamps))


def first_pass(stamps: Floats) -> int:
    """How many messages come before the recording begins again; stamps in the order of the bag [s], (n,)."""
    if not len(stamps):
        return 0
    back = np.flatnonzero(stamps < np.maximum.accumulate(stamps) - MIN_LOOP)
    return int(back[0]) if back.size else len(stamps)


def _lag(stamps: Floats, times: Floats) -> float:
    """How far the bag's times lie behind the stamps [s]."""
    return float(np.median(times - stamps)) if len(stamps) else 0.0


def _fault(stamps: Floats, times: Floats) -> str | None:
    """Why the stamps of a topic (n,) [s] cannot be true, with a place for its name; None where they can, or where the
    bag's `times` are no better."""
    if len(stamps) <= 2 or not np.mean(np.diff(times) == 0.0) < 0.5:
        return None
    if np.ptp(stamps) == 0.0:
        return f"all stamps of {{}} are {stamps[0]:g} s"
    if np.mean(np.diff(stamps) == 0.0) > 0.5:
        return "most stamps of {} repeat the one before"
    return _wrong_unit(stamps, times) if len(stamps) >= MIN_STAMPS else None


def _wrong_unit(stamps: Floats, times: Floats) -> str | None:
    """Say that stamps (n,) count something else than seconds and nanoseconds, as `_fault` does."""
    fractions = stamps - np.floor(stamps)
    if 0.0 < fractions.max() < MAX_FRACTION < np.median(times - np.floor(times)):
        return "the stamps of {} count no nanoseconds in their fractions of a second"
    step, tick = np.median(np.abs(np.diff(stamps))), np.median(np.abs(np.diff(times)))
    ratios = {unit: step / tick / factor for factor, unit in UNITS} if tick > 0.0 else {}
    found = next((unit for unit, ratio in ratios.items() if abs(ratio - 1.0) < MAX_RATE_ERROR), None)
    return f"the stamps of {{}} count {found} as seconds" if found else None


def _without_zeros(content: BagContent, stamps: Floats, times: Floats, whose: str) -> Floats:
    """Stamps (n,) [s] with the bag's time for those that are zero, where a driver leaves out some of them."""
    zero = stamps == 0.0
    if zero.sum() < 2 or zero.all():
        return stamps
    rows = np.flatnonzero(~zero)
    following = rows[np.minimum(np.searchsorted(rows, np.flatnonzero(zero)), len(rows) - 1)]
    if (np.abs(stamps[following]) > MIN_LOOP).sum() < 2:  # zero is the first stamp of each pass
        return stamps
    content.notes.append(f"{zero.sum()} stamps of {whose} are 0: the bag's own times are used for them")
    return np.where(zero, times - _lag(stamps[~zero], times[~zero]), stamps)


def _strays(content: BagContent, stamps: Floats, whose: str) -> NDArray[np.bool_]:
    """Tell which stamps (n,) [s], in the order of the bag, are far from those of their neighbours on both sides."""
    if len(stamps) < 2 * NEIGHBOURS + 1:
        return np.zeros(len(stamps), dtype=bool)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(stamps, NEIGHBOURS, mode="reflect"), 2 * NEIGHBOURS + 1)
    usual = float(np.median(np.abs(np.diff(stamps))))
    found: NDArray[np.bool_] = np.abs(stamps - np.median(windows, axis=1)) > max(MIN_LOOP, FAR * usual)
    if found.any():
        content.notes.append(f"{found.sum()} stamps of {whose} are far from those of their neighbours: left out")
    return found


def _steps_back(stamps: Floats, times: Floats) -> list[int]:
    """Messages from which on the stamps (n,) lie further behind the bag's `times` than before, by a step back [s]."""
    if _merely_disordered(stamps):
        return []
    lags, span = times - stamps, 2 * NEIGHBOURS + 1
    return [
        row
        for row in (np.flatnonzero(np.diff(stamps) < -MIN_STEP_BACK) + 1).tolist()
        if np.median(lags[row : row + span]) - np.median(lags[max(row - span, 0) : row]) > MIN_STEP_BACK
    ]


def _merely_disordered(stamps: Floats) -> bool:
    """Whether messages only came in another order, as of a recorder that is overloaded: sorted, their stamps (n,) [s]
    come at one rate. Those of a clock that was set back overlap."""
    gaps = np.diff(np.sort(stamps))
    return len(gaps) > 0 and bool(gaps.min() > REGULAR * np.median(gaps))


def _begins_again(stamps: Floats, steps: list[int]) -> bool:
    """Whether one of the steps leads back to where the recording began, as where it is played again."""
    first = stamps[: steps[0]].min()
    return any(stamps[row] < first + BEGIN_SHARE * (stamps[:row].max() - first) for row in steps)


def _goes_on(poses: Floats, times: Floats, steps: list[int]) -> bool:
    """Whether the robot drives on where its clock steps back: poses (n, 3), times of the bag (n,) [s]."""
    usual = float(np.median(np.diff(times)))
    before = [row - 1 for row in steps]
    spans = np.maximum(times[steps] - times[before], max(usual, 1e-3))
    return not has_jumped(se2.between(poses[before], poses[steps]), spans).any()


def _on_one_clock(content: BagContent, stamps: Floats, times: Floats, whose: str) -> Floats:
    """Stamps (n,) [s] of a clock that may have been set back; as they are where the recording begins again."""
    steps = _steps_back(stamps, times)
    return stamps if not steps or _begins_again(stamps, steps) else _joined(content, stamps, times, steps, whose)


def _joined(content: BagContent, stamps: Floats, times: Floats, steps: list[int], whose: str) -> Floats:
    """Stamps (n,) [s] of a clock that was set back, by the clock as it was at first; the bag's times relate them."""
    pieces = np.split(np.arange(len(stamps)), steps)
    lags = [_lag(stamps[piece], times[piece]) for piece in pieces]
    content.notes.append(
        f"the clock of {whose} was set back by {lags[1] - lags[0]:.2f} s at {stamps[steps[0] - 1]:.2f} s"
        f"{f', and {len(steps) - 1} times more' if len(steps) > 1 else ''}: the bag's own times relate what follows"
    )
    return np.concatenate([stamps[piece] + (lag - lags[0]) for piece, lag in zip(pieces, lags, strict=True)])


def _repeated(scans: RawScans, stamps: Floats) -> NDArray[np.bool_]:
    """Tell which scans have the stamp (n,) [s], the frame and the readings of the one before."""
    alike = np.append(False, np.diff(stamps) == 0.0)[: len(scans)]
    for row in np.flatnonzero(alike).tolist():
        same_lidar = scans.head(row - 1).frame_id == scans.head(row).frame_id
        alike[row] = same_lidar and np.array_equal(scans.ranges_of(row - 1), scans.ranges_of(row), equal_nan=True)
    return alike
