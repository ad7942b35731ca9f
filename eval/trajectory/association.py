# SPDX-License-Identifier: MIT
"""Match the poses of two trajectories by time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.trajectory import Trajectory, travelled
from slam.se2 import wrap_angle

TOLERANCE = 0.01
"""Largest difference of stamps that match [s] (evo's default as well)."""
MAX_GAP = 0.5
"""Largest gap between reference poses over which poses are interpolated [s]."""
MAX_PATH_GAP = 10.0
"""Longest path between two matched poses that counts as covered [m]."""
MIN_SHARE = 0.01
"""Smallest share of matched poses; with fewer the stamps agree by chance only."""


class AssociationError(ValueError):
    """Two trajectories that cannot be compared; the message gives both time spans and the tolerance."""


@dataclass(frozen=True, eq=False)
class Association:
    """Pairs of poses of an estimate and of a reference at the same times, in the order of time.

    Where both have identical stamps the order of the files is kept.
    """

    estimate: Trajectory
    """The estimate's poses that were matched, (n,)."""
    reference: Trajectory
    """The reference at those times, (n,)."""
    rows: NDArray[np.intp]
    """Rows of these poses in the whole estimate, (n,)."""
    total: int
    """Number of poses of the whole estimate."""
    method: str
    """Description of the matching, with its tolerance."""
    same_stamps: bool = False
    """Whether both trajectories have identical stamps."""
    notes: tuple[str, ...] = ()
    """Sentences on repeated stamps, stamps that step back, and poses without a match."""

    @property
    def share(self) -> float:
        """Share of the estimate's poses that were matched, 0 to 1."""
        return len(self.rows) / self.total


def associate(
    estimate: Trajectory,
    reference: Trajectory,
    *,
    tolerance: float = TOLERANCE,
    interpolate: bool = True,
    max_gap: float = MAX_GAP,
) -> Association:
    """Match each pose of `estimate` with the reference's pose of the same time.

    Trajectories with identical stamps are matched row by row, in whatever order the stamps are. Otherwise both are
    sorted by time (of repeated stamps of the reference the first counts), and a pose is matched with the reference at
    its stamp: interpolated between neighbours up to `max_gap` [s] apart (straight line, shorter turn), else the
    nearest within `tolerance` [s]. With `interpolate=False` only the nearest counts.
    Raises AssociationError if no pose, or less than `MIN_SHARE` of them, has a match.
    """
    total = len(estimate)
    if np.array_equal(estimate.stamps, reference.stamps):
        return Association(estimate, reference, np.arange(total), total, "same stamps, row by row", same_stamps=True)

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
    return Association(estimate[rows], Trajectory(at[found], partners[found]), rows, total, method, notes=tuple(notes))


def covered_share(matched: Association, reference: Trajectory) -> float:
    """Return the share of the reference's path between the times of matched poses, 0 to 1.

    Pieces of more than `MAX_PATH_GAP` between two matched poses do not count. The share of matched poses does not show
    an estimate that ends early, or that has few poses. The result is 1 for a reference that does not move.
    """
    order = np.argsort(reference.stamps, kind="stable")
    path = travelled(reference.poses[order])
    if not path[-1] > 0.0:
        return 1.0
    pieces = np.diff(np.interp(np.sort(matched.estimate.stamps), reference.stamps[order], path))
    return float(pieces[pieces <= MAX_PATH_GAP].sum() / path[-1])


def _between_poses(a: NDArray[np.float64], b: NDArray[np.float64], part: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate poses (n, 3) at `part` (n,) of the motion from a to b: straight line, shorter turn."""
    difference = b - a
    difference[:, 2] = wrap_angle(difference[:, 2])
    return a + part[:, None] * difference


def _span(trajectory: Trajectory) -> str:
    return f"{len(trajectory)} poses from {trajectory.stamps.min():.6f} to {trajectory.stamps.max():.6f} s"
