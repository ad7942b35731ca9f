# SPDX-License-Identifier: MIT
"""Score against relations: the truth is a list of relative poses between pairs of stamps; no alignment is needed.

Source: Kümmerle, Steder, Dornhege, Ruhnke, Grisetti, Stachniss, Kleiner, "On measuring the accuracy of SLAM
algorithms", Autonomous Robots 27(4), 2009. One relation a line, metres and radians:
`t1 t2 x y z roll pitch yaw`, the pose at t2 seen from the pose at t1.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.errors import Statistics
from eval.trajectory.trajectory import Trajectory
from slam.se2 import Pose, between

EXACT = 1e-6
"""Largest difference of stamps that are equal in files with six decimals [s]."""
MAX_SHORT = 20.0
"""Errors of pairs up to this far apart in time are short, others are loops [s]."""
FAILURE_M = 0.5
"""A pair with a larger error of translation counts as failed [m]."""


class RelationsError(ValueError):
    """A file without valid relations, or relations that match none of a trajectory's stamps."""


@dataclass(frozen=True, eq=False)
class Relations:
    """Relative poses between pairs of stamps."""

    first: NDArray[np.float64]
    """Stamp of the first pose [s], (k,)."""
    second: NDArray[np.float64]
    """Stamp of the second pose [s], (k,)."""
    poses: Pose
    """The second pose seen from the first [m, m, rad], (k, 3)."""

    def __len__(self) -> int:
        return len(self.first)


@dataclass(frozen=True)
class PairErrors:
    """Errors of some pairs: mean and standard deviation as published, and the tail that means hide."""

    translation: Statistics
    """Lengths [m]."""
    translation_squared: Statistics
    """Squared lengths [m^2]."""
    rotation: Statistics
    """Absolute angles [deg]."""
    rotation_squared: Statistics
    """Squared angles [deg^2]."""
    failure_share: float
    """Share of pairs with more than `FAILURE_M` of translational error, 0 to 1."""


@dataclass(frozen=True, eq=False)
class RelationError:
    """Score of one trajectory against relations."""

    all: PairErrors
    """All matched pairs."""
    short: PairErrors | None
    """Errors of pairs up to `MAX_SHORT` apart; None where there are none."""
    loops: PairErrors | None
    """Errors of pairs further apart; None where there are none."""
    unmatched: int
    """Number of relations with a stamp that the trajectory does not have."""
    covered: float
    """Share of the relations whose stamps lie within the trajectory's time span, 0 to 1: below 1 it ends early."""
    tolerance: float
    """Largest difference of stamps that were matched [s]."""
    matched: NDArray[np.intp]
    """Indices of the relations that were scored, (m,)."""
    translation_errors: NDArray[np.float64]
    """Error of each scored relation [m], (m,)."""
    rotation_errors: NDArray[np.float64]
    """Error of each scored relation [deg], (m,)."""
    notes: tuple[str, ...]


def read_relations(path: str | os.PathLike[str]) -> Relations:
    """Read a relations file; `#` starts a comment.

    Raises RelationsError, naming file and line, for a wrong count of columns, what is not a finite number, a yaw
    beyond a full turn (degrees?), a relation out of the plane, or no relation at all; OSError as `open` does.
    """
    path = Path(path)
    rows = []
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            fields = line.partition("#")[0].split()
            if fields:
                rows.append(_parse(f"{path}:{number}", fields))
    if not rows:
        raise RelationsError(f"{path}: expected relations 't1 t2 x y z roll pitch yaw', found none")
    table = np.array(rows)
    return Relations(table[:, 0], table[:, 1], table[:, [2, 3, 7]])


def _parse(position: str, fields: list[str]) -> list[float]:
    if len(fields) != 8:
        raise RelationsError(f"{position}: expected 8 numbers 't1 t2 x y z roll pitch yaw', got {len(fields)}")
    try:
        row = [float(field) for field in fields]
    except ValueError:
        raise RelationsError(f"{position}: expected 8 numbers, got '{' '.join(fields)[:80]}'") from None
    if not np.isfinite(row).all():
        raise RelationsError(f"{position}: expected finite numbers, got NaN or infinity")
    if abs(row[7]) > 2.0 * np.pi:
        raise RelationsError(f"{position}: expected a yaw in radians, got {row[7]} (degrees?)")
    if max(abs(row[5]), abs(row[6])) > 1e-3:
        raise RelationsError(f"{position}: expected a relation in the plane (roll = pitch = 0), got {row[5]}, {row[6]}")
    return row


def relation_error(trajectory: Trajectory, relations: Relations, *, tolerance: float = EXACT) -> RelationError:
    """Score a trajectory: E = relation^-1 (P(t1)^-1 P(t2)); length of E [m] and absolute yaw of E [deg].

    A pair counts if both stamps are in the trajectory within `tolerance` [s]; the trajectory's stamps may be in any
    order, and the first of repeated ones counts. Range 0 and up. Traps: a loose tolerance matches pairs to wrong poses
    where stamps come in bursts (Intel: 14 frames in 12 ms); a mean hides lost loops, so read `loops`.
    Raises RelationsError if no pair is matched.
    """
    stamps, first_row = np.unique(trajectory.stamps, return_index=True)
    one, off_one = _nearest(stamps, relations.first)
    two, off_two = _nearest(stamps, relations.second)
    matched = np.flatnonzero((off_one <= tolerance) & (off_two <= tolerance))
    if len(matched) == 0:
        raise RelationsError(
            f"none of the {len(relations)} relations ({min(relations.first.min(), relations.second.min()):.6f} to "
            f"{max(relations.first.max(), relations.second.max()):.6f} s) has both stamps in the trajectory "
            f"({stamps[0]:.6f} to {stamps[-1]:.6f} s) within {tolerance} s"
        )
    poses = trajectory.poses[first_row]
    motion = between(poses[one[matched]], poses[two[matched]])
    error = between(relations.poses[matched], motion)
    translation, rotation = np.hypot(error[:, 0], error[:, 1]), np.degrees(np.abs(error[:, 2]))
    short = np.abs(relations.second - relations.first)[matched] <= MAX_SHORT
    times = np.column_stack([relations.first, relations.second])
    within = ((times >= stamps[0] - tolerance) & (times <= stamps[-1] + tolerance)).all(axis=1)
    return RelationError(
        all=_pair_errors(translation, rotation),
        short=_pair_errors(translation[short], rotation[short]) if short.any() else None,
        loops=_pair_errors(translation[~short], rotation[~short]) if not short.all() else None,
        unmatched=len(relations) - len(matched),
        covered=float(within.mean()),
        tolerance=tolerance,
        matched=matched,
        translation_errors=translation,
        rotation_errors=rotation,
        notes=_repeated(trajectory, poses, stamps),
    )


def _nearest(stamps: NDArray[np.float64], wanted: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the index of the nearest of the sorted stamps to each wanted one, and the difference [s]."""
    after = np.clip(np.searchsorted(stamps, wanted), 0, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    index = np.where(np.abs(wanted - stamps[before]) < np.abs(stamps[after] - wanted), before, after)
    return index, np.abs(stamps[index] - wanted)


def _repeated(trajectory: Trajectory, poses: Pose, stamps: NDArray[np.float64]) -> tuple[str, ...]:
    repeats = len(trajectory) - len(stamps)
    if repeats == 0:
        return ()
    off = trajectory.poses[:, :2] - poses[np.searchsorted(stamps, trajectory.stamps), :2]
    moved = np.hypot(off[:, 0], off[:, 1]).max()
    return (f"{repeats} repeated stamps: the first pose of each counts, the others are up to {moved:.3f} m off",)


def _pair_errors(translation: NDArray[np.float64], rotation: NDArray[np.float64]) -> PairErrors:
    return PairErrors(
        Statistics.of(translation),
        Statistics.of(translation**2),
        Statistics.of(rotation),
        Statistics.of(rotation**2),
        float(np.mean(translation > FAILURE_M)),
    )
