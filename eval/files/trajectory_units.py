# SPDX-License-Identifier: MIT
"""Units of a trajectory's stamps and headings, as far as the numbers show them."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from slam.se2 import wrap_angle

_UNITS = ((1e9, "nanoseconds"), (1e6, "microseconds"), (1e3, "milliseconds"))
"""Units of stamps, per second."""
_YEARS = (1.0e9, 4.1e9)
"""Stamps since 1970 lie between 2001 and 2099 [s]."""
_MAX_STEP = 100.0
"""Poses of stamps since 1970 are usually at most this far apart [s]."""
_LONG, _SLOW, _SPEEDS = 5.0, 0.003, (0.02, 3.0)
"""Poses so far apart [s] on a path that is so slow [m/s] have stamps in the unit that gives a robot's speed."""
_MIN_POSES = 10
"""Of fewer poses nothing is said."""
_MANY, _MOST = 0.1, 0.5
"""Shares of poses that have the stamp of another one."""
_CHORDS = 100
"""The path is cut into so many pieces to compare headings with the direction of travel."""
_CLEAR = 0.3
"""Headings in one reading follow the path if its score is larger than that of another one by this."""

_WITH_FRACTION = re.compile(r"\d+\.\d{1,9}")

Floats = NDArray[np.float64]


def in_seconds(stamps: Floats, places: Floats) -> tuple[Floats, list[str]]:
    """Return stamps (n,) in s, and notes on what they are read as; places (n, 2) [m].

    Raises ValueError where most poses at different places have the stamp of the one before.
    """
    step = float(np.median(np.abs(np.diff(stamps)))) if len(stamps) > 1 else 0.0
    notes = []
    for per_second, unit in _UNITS:
        least, largest = stamps.min() / per_second, stamps.max() / per_second
        if _YEARS[0] < least and largest < _YEARS[1] and step < _MAX_STEP * per_second:
            stamps = stamps / per_second
            notes.append(f"stamps are read as {unit}")
            break
    else:
        stamps, notes = _by_speed(stamps, places, step)
    if len(stamps) < _MIN_POSES:
        return stamps, notes
    moved = (np.diff(places, axis=0) != 0.0).any(axis=1)
    repeated = int(((np.diff(stamps) == 0.0) & moved).sum())
    if repeated > _MOST * len(moved):
        raise ValueError(
            f"{repeated} of {len(stamps)} poses have the stamp of the one before: rounded stamps, or several robots; "
            "expected a stamp for each pose"
        )
    if repeated > _MANY * len(moved):
        notes.append(f"{repeated} of {len(stamps)} poses have the stamp of the one before: were the stamps rounded?")
    if (np.diff(stamps) == 1.0).all() and stamps[0] in (0.0, 1.0):
        notes.append("the stamps count the poses: are they times in s?")
    return stamps, notes


def with_zeros(texts: list[str], stamps: Floats) -> Floats | None:
    """Stamps (n,) [s] of a program that wrote seconds, a point, and a count of nano-, micro- or milliseconds without
    its zeros in front, as `printf("%d.%d")` does; None where they are none of these.

    texts: the stamps as the file has them. As they stand they step back again and again; read so they never do.
    """
    if not (np.diff(stamps) < 0.0).any() or not all(map(_WITH_FRACTION.fullmatch, texts)):
        return None
    fractions = [text.partition(".")[2] for text in texts]
    longest = max(map(len, fractions))
    digits = next(count for count in (3, 6, 9) if longest <= count)
    padded: Floats = np.floor(stamps) + np.array([int(fraction) for fraction in fractions]) / 10.0**digits
    return padded if (np.diff(padded) >= 0.0).all() else None


def _by_speed(stamps: Floats, places: Floats, step: float) -> tuple[Floats, list[str]]:
    """Stamps that are no times since 1970, in the unit in which the robot is as fast as robots are."""
    span = float(np.ptp(stamps))
    if len(stamps) < _MIN_POSES or step <= _LONG or span == 0.0:
        return stamps, []
    speed = float(np.hypot(*np.diff(places, axis=0).T).sum()) / span
    if speed >= _SLOW:
        return stamps, []
    for per_second, unit in _UNITS:
        if _SPEEDS[0] < speed * per_second < _SPEEDS[1] and step < _LONG * per_second:
            return stamps / per_second, [f"stamps are read as {unit}: in seconds the robot would make {speed:.2g} m/s"]
    return stamps, [f"poses are {step:g} s apart: are the stamps in seconds?"]


def in_radians(yaws: Floats, places: Floats, *, is_stated: bool) -> tuple[Floats, list[str]]:
    """Return headings (n,) in rad, and notes; places (n, 2) [m]; is_stated: the file says the unit, it is rad by now.

    Raises ValueError where they may be degrees or radians, or turn clockwise.
    """
    scores = {
        (unit, turn): _follows(turn * factor * yaws, places)
        for unit, factor in (("rad", 1.0), ("deg", np.radians(1.0)))
        for turn in (1, -1)
    }
    unit = "rad"
    notes = []
    if not is_stated and np.abs(yaws).max(initial=0.0) > 2.1 * np.pi:
        best = {name: max(scores[name, 1], scores[name, -1]) for name in ("rad", "deg")}
        unit = max(best, key=lambda name: best[name])
        if best[unit] - min(best.values()) < _CLEAR:
            raise ValueError(
                f"headings of up to {np.abs(yaws).max():.0f} may be degrees or radians: expected a column yaw_deg or "
                "yaw_rad"
            )
        if unit == "deg":
            notes.append("headings are read as degrees")
    if scores[unit, -1] - scores[unit, 1] > _CLEAR:
        raise ValueError("headings turn clockwise, as those of a compass, expected counter-clockwise from x to y")
    return np.radians(yaws) if unit == "deg" else yaws, notes


def _follows(yaws: Floats, places: Floats) -> float:
    """How well headings (n,) [rad] follow the path's direction, up to a constant and to driving backwards, 0 to 1."""
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(places, axis=0).T)))
    if len(way) < _MIN_POSES or way[-1] == 0.0:
        return 0.0
    ends = np.unique(np.searchsorted(way, np.linspace(0.0, way[-1], _CHORDS + 1)).clip(0, len(way) - 1))
    chords = np.diff(places[ends], axis=0)
    middle = (ends[:-1] + ends[1:]) // 2
    off = wrap_angle(np.arctan2(chords[:, 1], chords[:, 0]) - yaws[middle])
    return float(np.abs(np.average(np.exp(2j * off), weights=np.hypot(*chords.T))))
