# SPDX-License-Identifier: MIT
"""Find a constant difference of clocks between an estimate and the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from eval.trajectory.trajectory import Trajectory
from slam.se2 import wrap_angle

MAX_OFFSET, MAX_OFFSET_SHARE = 60.0, 0.3
"""Offsets are searched up to this [s], and up to this share of the shorter time span."""
EXPLAINED = 1.0 / 3.0
"""An offset explains an error if it reduces it to this share."""
MIN_OFFSET, MIN_GAIN, MIN_GAIN_DEG = 0.01, 0.01, 1.0
"""Smaller offsets [s], or gains [m] and [deg], are not reported."""
_STEP = 0.1
"""Step of the search [s]; robots move so slowly that the error is smooth over it."""
_MIN_OVERLAP = 0.7
"""Smallest share of the poses that lies within the reference's time span at an offset."""
_MAX_POSES = 400
_MAX_MINIMA = 12
"""Best local minima that are refined."""
_EQUAL = 2.0
"""Errors up to this many times the least one count as equal; of these the smallest offset is taken."""
_NO_OVERLAP = 1e9
"""Error of an offset at which too few poses have a reference [m]; finite, as the refinement calculates with it."""


@dataclass(frozen=True)
class TimeOffset:
    """An offset of the clock, and the error of an estimate without it and with it."""

    seconds: float
    """What must be added to the stamps of the estimate [s]."""
    error_before: float | None
    """ATE rmse without the offset [m]; None where the time spans do not overlap."""
    error_after: float
    """ATE rmse with the offset [m]."""
    degrees_before: float | None
    """Root mean square of the heading errors without the offset [deg], their mean left out; None as above."""
    degrees_after: float
    """The same with the offset [deg]."""
    explains: bool
    """Whether it explains the error, by positions or by headings."""


def find_time_offset(estimate: Trajectory, reference: Trajectory) -> TimeOffset | None:
    """Return the constant offset of the stamps that explains the error of `estimate`; None where there is none.

    It explains the error if it reduces the ATE rmse after SE(2) alignment to the share `EXPLAINED`, or the rms of the
    headings, without making the ATE worse. Headings show a shift of which the positions of a poor estimate show little:
    0.3 s are 9 degrees in a turn at 30 degrees/s, and 6 cm at 0.2 m/s.
    """
    best = best_time_offset(estimate, reference)
    return best if best is not None and best.explains else None


def best_time_offset(estimate: Trajectory, reference: Trajectory) -> TimeOffset | None:
    """Return the constant offset of the stamps that reduces the error of `estimate` most; None where no offset lets
    enough poses overlap.

    The offset minimises the heading errors where that explains the error, else the ATE rmse, with the reference
    interpolated at the shifted stamps. It is searched around 0, or, where the spans hardly overlap, around equal
    beginnings and equal ends.
    Trap: on a path that repeats itself in time several offsets fit; the smallest is returned.
    """
    pair = _Pair.of(estimate, reference)
    if pair.overlap and pair.degrees(0.0) >= MIN_GAIN_DEG / (1.0 - EXPLAINED):
        found = _search(pair.degrees, pair.bases, pair.reach, slack=0.5 * MIN_GAIN_DEG)
        if found is not None and (by_headings := pair.offset(found)).explains:
            return by_headings
    found = _search(pair.metres, pair.bases, pair.reach, slack=0.5 * MIN_GAIN)
    return None if found is None else pair.offset(found)


@dataclass(frozen=True, eq=False)
class _Pair:
    """An estimate, thinned out, and its reference in the order of time."""

    at: NDArray[np.float64]
    """Stamps of the estimate [s], (n,)."""
    poses: NDArray[np.float64]
    stamps: NDArray[np.float64]
    """Stamps of the reference [s], (k,)."""
    path: NDArray[np.float64]
    """Its poses, headings without jumps by a turn, (k, 3)."""

    @classmethod
    def of(cls, estimate: Trajectory, reference: Trajectory) -> _Pair:
        rows = np.unique(np.linspace(0, len(estimate) - 1, _MAX_POSES).astype(np.intp))
        stamps, first = np.unique(reference.stamps, return_index=True)
        path = reference.poses[first].copy()
        path[:, 2] = np.unwrap(path[:, 2])
        return cls(estimate.stamps[rows], estimate.poses[rows], stamps, path)

    @property
    def overlap(self) -> bool:
        """Whether enough poses have a reference as the stamps are."""
        return self.metres(0.0) < _NO_OVERLAP

    @property
    def reach(self) -> float:
        """How far offsets are searched [s]."""
        return float(min(MAX_OFFSET, MAX_OFFSET_SHARE * min(np.ptp(self.at), np.ptp(self.stamps))))

    @property
    def bases(self) -> list[float]:
        """Offsets around which is searched [s]."""
        if self.overlap:
            return [0.0]
        return [float(self.stamps[0] - self.at.min()), float(self.stamps[-1] - self.at.max())]

    def metres(self, offset: float) -> float:
        """ATE rmse at an offset [m]."""
        inside, shifted = self._inside(offset)
        if not inside.any():
            return _NO_OVERLAP
        found = np.column_stack([np.interp(shifted, self.stamps, self.path[:, axis]) for axis in (0, 1)])
        return aligned_rmse(self.poses[inside, :2], found)

    def degrees(self, offset: float) -> float:
        """Root mean square of the heading errors at an offset [deg], their mean left out."""
        inside, shifted = self._inside(offset)
        if not inside.any():
            return _NO_OVERLAP
        miss = np.interp(shifted, self.stamps, self.path[:, 2]) - self.poses[inside, 2]
        mean = np.arctan2(np.sin(miss).mean(), np.cos(miss).mean())
        return float(np.degrees(np.sqrt(np.mean(wrap_angle(miss - mean) ** 2))))

    def _inside(self, offset: float) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Which poses have a reference at an offset, (n,), none where these are too few, and their shifted stamps."""
        shifted = self.at + offset
        inside = (shifted >= self.stamps[0]) & (shifted <= self.stamps[-1])
        if inside.sum() < max(_MIN_OVERLAP * len(self.at), 3):
            inside[:] = False
        return inside, shifted[inside]

    def offset(self, seconds: float) -> TimeOffset:
        """An offset with the errors without it and with it."""
        after, degrees_after = self.metres(seconds), self.degrees(seconds)
        if not self.overlap:  # the error to be explained is that of a single point
            alone = float(np.sqrt(self.path[:, :2].var(axis=0).sum()))
            return TimeOffset(seconds, None, after, None, degrees_after, after <= EXPLAINED * alone)
        before, degrees_before = self.metres(0.0), self.degrees(0.0)
        by_positions = after <= EXPLAINED * before and before - after >= MIN_GAIN
        by_headings = (
            degrees_after <= EXPLAINED * degrees_before
            and degrees_before - degrees_after >= MIN_GAIN_DEG
            and after <= before
        )
        explains = abs(seconds) >= MIN_OFFSET and (by_positions or by_headings)
        return TimeOffset(seconds, before, after, degrees_before, degrees_after, explains)


def _search(error: Callable[[float], float], bases: list[float], reach: float, slack: float) -> float | None:
    """Return the offset at which an error is least [s], of those that are equally good the smallest; None where no
    offset has an error. slack: such a difference is none."""
    found = [minimum for base in bases for minimum in _local_minima(error, base, reach)]
    if not found:
        return None
    least = min(after for _, _, after in found)
    return min(item for item in found if item[2] <= _EQUAL * least + slack)[1]


def _local_minima(error: Callable[[float], float], base: float, reach: float) -> list[tuple[float, float, float]]:
    """Return the best local minima of an error within `reach` of `base` [s]: distance from it, offset, error."""
    tried = base + np.arange(-reach - _STEP, reach + 2.0 * _STEP, _STEP)
    errors = np.array([error(offset) for offset in tried])
    inner = errors[1:-1]
    lowest = np.flatnonzero((inner <= errors[:-2]) & (inner <= errors[2:]) & (inner < _NO_OVERLAP))
    found = []
    for k in lowest[np.argsort(inner[lowest], kind="stable")][:_MAX_MINIMA] + 1:
        fit = minimize_scalar(error, bounds=(tried[k - 1], tried[k + 1]), method="bounded", options={"xatol": 1e-4})
        after, seconds = min((float(fit.fun), float(fit.x)), (float(errors[k]), float(tried[k])))
        found.append((abs(seconds - base), seconds, after))
    return found


def aligned_rmse(points: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    """Return the rms distance of points (n, 2) to others (n, 2) after the SE(2) motion that minimises it [m]."""
    p, q = points - points.mean(axis=0), others - others.mean(axis=0)
    cosine, sine = np.sum(p * q), np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])
    squares = np.sum(p * p) + np.sum(q * q) - 2.0 * np.hypot(cosine, sine)
    return float(np.sqrt(max(squares, 0.0) / len(p)))
