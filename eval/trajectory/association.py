# SPDX-License-Identifier: MIT
"""Which pose of one trajectory belongs to which pose of another: by time, with the share that found a partner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.trajectory import Trajectory, travelled
from slam.se2 import wrap_angle

TOLERANCE = 0.01
"""Stamps that differ by up to this much belong together [s] (evo's default as well)."""
MAX_GAP = 0.5
"""Between reference poses further apart than this nothing is interpolated [s]."""
MIN_SHARE = 0.01
"""Below this share of matched poses the stamps meet by chance only."""


class AssociationError(ValueError):
    """Two trajectories that cannot be compared; the message gives both time spans and the tolerance."""


@dataclass(frozen=True, eq=False)
class Association:
    """Pairs of an estimate's poses and the reference's poses at the same times, in the order of time.

    Only where both have the very same stamps they stay in the order of the files."""

    estimate: Trajectory
    """The estimate's poses that found a partner, (n,)."""
    reference: Trajectory
    """The reference at those times, (n,)."""
    rows: NDArray[np.intp]
    """Which rows of the whole estimate they are, (n,)."""
    total: int
    """Poses of the whole estimate."""
    method: str
    """How partners were found, in words, with the tolerance."""
    notes: tuple[str, ...] = ()
    """What a reader of the result must know: repeated stamps, a small share."""

    @property
    def share(self) -> float:
        """Share of the estimate's poses that found a partner, 0 to 1."""
        return len(self.rows) / self.total


def associate(
    estimate: Trajectory,
    reference: Trajectory,
    *,
    tolerance: float = TOLERANCE,
    interpolate: bool = True,
    max_gap: float = MAX_GAP,
) -> Association:
    """Give each pose of `estimate` the reference's pose of the same time.

    Trajectories with the very same stamps go together row by row, whatever order the stamps are in. Otherwise both
    are sorted by time (of repeated stamps the reference's first counts) and a pose takes the reference's at its stamp:
    interpolated between neighbours up to `max_gap` [s] apart (straight line, shorter turn), else the nearest within
    `tolerance` [s]. With `interpolate=False` the nearest only.
    Raises AssociationError if not one pose finds a partner, or less than `MIN_SHARE` of them.
    """
    total = len(estimate)
    if np.array_equal(estimate.stamps, reference.stamps):
        return Association(estimate, reference, np.arange(total), total, "same stamps, row by row")

    stamps, first = np.unique(reference.stamps, return_index=True)
    poses = reference.poses[first]
    notes = []
    if len(stamps) < len(reference):
        notes.append(f"{len(reference) - len(stamps)} repeated stamps in the reference: the first pose of each counts")

    order = np.argsort(estimate.stamps, kind="stable")
    at = estimate.stamps[order]
    back = int(np.sum(np.diff(estimate.stamps) < 0.0))
    if back:
        notes.append(f"the estimate's stamps step back {back} times: its poses were put in the order of time")
    if (repeats := int(np.sum(np.diff(at) == 0.0))) > 0:
        notes.append(f"{repeats} repeated stamps in the estimate: all of their poses count")
    after = np.clip(np.searchsorted(stamps, at), 0, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(at - stamps[before] <= stamps[after] - at, before, after)
    found = np.abs(stamps[nearest] - at) <= tolerance
    partners = poses[nearest]
    if interpolate:
        gap = stamps[after] - stamps[before]
        inside = (stamps[before] <= at) & (at <= stamps[after]) & (gap <= max_gap) & (gap > 0.0)
        part = np.divide(at - stamps[before], gap, out=np.zeros_like(at), where=inside)
        partners = np.where(inside[:, None], _between_poses(poses[before], poses[after], part), partners)
        found |= inside
    if not found.any():
        raise AssociationError(
            f"no pose of the estimate ({_span(estimate)}) has a partner in the reference ({_span(reference)}) within "
            f"{tolerance} s"
            + (f" or between poses up to {max_gap} s apart" if interpolate else "")
            + ": are both in seconds, and of one clock?"
        )
    rows = order[found]
    if len(rows) < MIN_SHARE * total:
        raise AssociationError(
            f"only {len(rows)} poses of the estimate ({_span(estimate)}) have a partner in the reference "
            f"({_span(reference)}): are both in seconds, and of one clock?"
        )
    if len(rows) < total:
        notes.append(f"{total - len(rows)} of {total} poses have no partner in the reference")
    method = f"nearest within {tolerance} s"
    if interpolate:
        method = f"interpolated over gaps up to {max_gap} s, else {method}"
    return Association(estimate[rows], Trajectory(at[found], partners[found]), rows, total, method, tuple(notes))


def covered_share(matched: Association, reference: Trajectory) -> float:
    """Share of the reference's path [m/m] that lies between the first and the last matched pose in time, 0 to 1.

    The share of matched poses does not show an estimate that ends early. 1 for a reference that does not move.
    """
    order = np.argsort(reference.stamps, kind="stable")
    path = travelled(reference.poses[order])
    ends = matched.estimate.stamps.min(), matched.estimate.stamps.max()
    first, last = np.interp(ends, reference.stamps[order], path)
    return float((last - first) / path[-1]) if path[-1] > 0.0 else 1.0


def _between_poses(a: NDArray[np.float64], b: NDArray[np.float64], part: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 3) at `part` (n,) of the way from a to b: positions on the straight line, headings the shorter way."""
    way = b - a
    way[:, 2] = wrap_angle(way[:, 2])
    return a + part[:, None] * way


def _span(trajectory: Trajectory) -> str:
    return f"{len(trajectory)} poses from {trajectory.stamps.min():.6f} to {trajectory.stamps.max():.6f} s"
