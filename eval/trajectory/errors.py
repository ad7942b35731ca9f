# SPDX-License-Identifier: MIT
"""Compute absolute and relative trajectory errors, and drift. Angles are in degrees, because people read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eval.trajectory.alignment import Alignment, Method, align
from eval.trajectory.association import Association
from slam.se2 import between, wrap_angle

Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]
"""First and second row of each pair, two arrays (k,)."""
TOLERANCE = 0.1
"""Largest deviation of a piece from its nominal length, as a share of that length."""


@dataclass(frozen=True)
class Statistics:
    """Summary of a sample of errors, in their own unit."""

    rmse: float
    mean: float
    std: float
    median: float
    p95: float
    max: float
    count: int

    @classmethod
    def of(cls, errors: ArrayLike) -> Statistics:
        """Summarise errors (n,), n >= 1; `std` divides by n, as the published tables do."""
        e = np.asarray(errors, dtype=np.float64)
        if e.ndim != 1 or len(e) == 0:
            raise ValueError(f"statistics take errors (n,) with n >= 1, got shape {e.shape}")
        return cls(
            rmse=float(np.sqrt(np.mean(e * e))),
            mean=float(e.mean()),
            std=float(e.std()),
            median=float(np.median(e)),
            p95=float(np.percentile(e, 95.0)),
            max=float(e.max()),
            count=len(e),
        )


@dataclass(frozen=True, eq=False)
class AbsoluteError:
    """Absolute trajectory error (ATE) under one named alignment."""

    translation: Statistics
    """Summary of the distances [m]."""
    rotation: Statistics
    """Summary of the absolute heading differences [deg]."""
    alignment: Alignment
    translation_errors: NDArray[np.float64]
    """Distance of each pose from the reference [m], (n,)."""
    rotation_errors: NDArray[np.float64]
    """Heading difference of each pose [deg], signed, (n,)."""


@dataclass(frozen=True, eq=False)
class RelativeError:
    """Relative pose error (RPE) over pieces of one length."""

    delta: float
    unit: Literal["m", "s", "poses"]
    translation: Statistics
    """Summary of the lengths of the errors [m]."""
    rotation: Statistics
    """Summary of the absolute angles of the errors [deg]."""
    pairs: Pairs
    """First and last row of each piece, two arrays (k,)."""


def absolute_error(matched: Association, method: Method = "se2") -> AbsoluteError:
    """Compute the ATE, e_i = |trans(Q_i) - trans(S P_i)| with the alignment S; headings use the same S.

    Unit m and degrees; range 0 and up, 0 and 180. Source: Sturm et al., IROS 2012.
    Trap: it grows with the length of the path and depends on WHEN an error happened (an early turn costs more).
    Compare runs of one path only, and read it with the relative error.
    """
    estimate, reference = matched.estimate.poses, matched.reference.poses
    alignment = align(estimate, reference, method)
    aligned = alignment.apply(estimate)
    distances = np.linalg.norm(aligned[:, :2] - reference[:, :2], axis=1)
    turns = np.degrees(wrap_angle(aligned[:, 2] - reference[:, 2]))
    return AbsoluteError(Statistics.of(distances), Statistics.of(np.abs(turns)), alignment, distances, turns)


def relative_error(matched: Association, delta: float, unit: Literal["m", "s", "poses"]) -> RelativeError | None:
    """Compute the RPE, E_i = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j), over all pieces i, j of length `delta`; None without one.

    Lengths are measured on the reference. `m`, `s`: j is the pose nearest to `delta` metres of path or seconds after
    i, if within a tenth of it; `poses`: `delta` rows after. Unit m and degrees, range 0 and up. Needs no alignment.
    Source: Sturm et al., IROS 2012. The same as evo's `all_pairs` with `pairs_from_reference`; evo's default takes
    consecutive pieces of the estimate's path instead, and no pieces by seconds.
    Trap: it does not show errors that build up slowly: read several lengths.
    """
    if not delta > 0:
        raise ValueError(f"the length of a piece must be positive, got {delta} {unit}")
    first, last = _pieces(matched, delta, unit)
    if len(first) == 0:
        return None
    translation, rotation = pair_errors(matched.estimate.poses, matched.reference.poses, (first, last))
    return RelativeError(delta, unit, Statistics.of(translation), Statistics.of(rotation), (first, last))


def pair_errors(
    estimate: ArrayLike, reference: ArrayLike, pairs: Pairs
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the error of the motion between each pair of rows: length [m], (k,), and absolute angle [deg], (k,)."""
    p, q = np.asarray(estimate, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    first, last = pairs
    error = between(between(q[first], q[last]), between(p[first], p[last]))
    return np.hypot(error[:, 0], error[:, 1]), np.degrees(np.abs(error[:, 2]))


def stretches(matched: Association, length: float) -> Pairs:
    """Pair each row with the first one at least `length` [m] of the reference's path later, two arrays (k,).

    Unlike the pieces of `relative_error` they exist however far apart the poses are (Geiger et al., CVPR 2012).
    """
    path = matched.reference.distance
    # Rounding alone makes the sum of many steps miss a round length.
    last = np.searchsorted(path, path + length - 1e-9 * max(1.0, path[-1]))
    first = np.flatnonzero(last < len(path))
    return first, last[first]


@dataclass(frozen=True)
class Drift:
    """Error per distance travelled, averaged over pieces of several lengths."""

    translation_percent: float
    """Metres of error per 100 m."""
    rotation_deg_per_m: float
    lengths: tuple[float, ...]
    """Lengths of the pieces that were used [m]."""


def drift(matched: Association, lengths: Sequence[float]) -> Drift | None:
    """Return the mean of RPE / length over all pieces of the given lengths [m]; None where the path is too short.

    Unit percent and deg/m, range 0 and up. Source: KITTI odometry benchmark (Geiger et al., CVPR 2012), there with
    lengths of 100 to 800 m, and pieces of at least each length instead of the nearest.
    Trap: a constant error (noise of single poses) weighs more on short pieces and looks like drift.
    """
    pieces = [(length, relative_error(matched, length, "m")) for length in lengths]
    found = [(length, piece) for length, piece in pieces if piece is not None]
    if not found:
        return None
    count = sum(piece.translation.count for _, piece in found)
    translation = sum(piece.translation.mean / length * piece.translation.count for length, piece in found)
    rotation = sum(piece.rotation.mean / length * piece.rotation.count for length, piece in found)
    return Drift(100.0 * translation / count, rotation / count, tuple(length for length, _ in found))


def _pieces(matched: Association, delta: float, unit: Literal["m", "s", "poses"]) -> Pairs:
    reference = matched.reference
    n = len(reference)
    if unit == "poses":
        step = int(delta)
        return np.arange(0, max(n - step, 0)), np.arange(step, max(n, step))
    order = np.arange(n) if unit == "m" else np.argsort(reference.stamps, kind="stable")
    along = reference.distance if unit == "m" else reference.stamps[order]
    target = along + delta
    after = np.minimum(np.searchsorted(along, target), n - 1)
    before = np.maximum(after - 1, 0)
    near = np.where(target - along[before] <= along[after] - target, along[before], along[after])
    last = np.searchsorted(along, near)  # the first pose where the robot stood still
    found = np.abs(near - target) <= TOLERANCE * delta
    if unit == "s":  # by metres several pieces may end at the last pose, as in evo
        found &= target <= along[-1] + 1e-6
    first = np.flatnonzero(found)
    return order[first], order[last[first]]
