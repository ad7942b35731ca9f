# SPDX-License-Identifier: MIT
"""Find a constant difference of clocks between an estimate and the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from eval.trajectory.trajectory import Trajectory

MAX_OFFSET, MAX_OFFSET_SHARE = 60.0, 0.3
"""Offsets are searched up to this [s], and up to this share of the shorter time span."""
EXPLAINED = 1.0 / 3.0
"""An offset explains an error if it reduces it to this share."""
MIN_OFFSET, MIN_GAIN = 0.01, 0.01
"""Smaller offsets [s], or gains [m], are not reported."""
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
    """An offset of the clock that explains the error of an estimate."""

    seconds: float
    """What must be added to the stamps of the estimate [s]."""
    error_before: float | None
    """ATE rmse without the offset [m]; None where the time spans do not overlap."""
    error_after: float
    """ATE rmse with the offset [m]."""


def find_time_offset(estimate: Trajectory, reference: Trajectory) -> TimeOffset | None:
    """Return the constant offset of the stamps that explains the error of `estimate`; None where there is none.

    The offset minimises the ATE rmse after SE(2) alignment, with the reference interpolated at the shifted stamps. It
    is searched around 0, or, where the spans hardly overlap, around equal beginnings and equal ends.
    Trap: on a path that repeats itself in time several offsets fit; the smallest is returned.
    """
    rows = np.unique(np.linspace(0, len(estimate) - 1, _MAX_POSES).astype(np.intp))
    at, points = estimate.stamps[rows], estimate.poses[rows, :2]
    stamps, first = np.unique(reference.stamps, return_index=True)
    path = reference.poses[first, :2]

    def error(offset: float) -> float:
        shifted = at + offset
        inside = (shifted >= stamps[0]) & (shifted <= stamps[-1])
        if inside.sum() < max(_MIN_OVERLAP * len(at), 3):
            return _NO_OVERLAP
        found = np.column_stack([np.interp(shifted[inside], stamps, path[:, axis]) for axis in (0, 1)])
        return aligned_rmse(points[inside], found)

    before = error(0.0)
    overlap = before < _NO_OVERLAP
    reach = min(MAX_OFFSET, MAX_OFFSET_SHARE * min(np.ptp(at), np.ptp(stamps)))
    bases = [0.0] if overlap else [stamps[0] - at.min(), stamps[-1] - at.max()]
    found = [minimum for base in bases for minimum in _local_minima(error, base, reach)]
    if not found:
        return None
    least = min(after for _, _, after in found)
    _, seconds, after = min(item for item in found if item[2] <= _EQUAL * least + 0.5 * MIN_GAIN)
    # Without a common time the error to be explained is that of a single point.
    if after > EXPLAINED * (before if overlap else float(np.sqrt(path.var(axis=0).sum()))):
        return None
    if overlap and (abs(seconds) < MIN_OFFSET or before - after < MIN_GAIN):
        return None
    return TimeOffset(seconds, before if overlap else None, after)


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
