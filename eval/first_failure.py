# SPDX-License-Identifier: MIT
"""Find where a run went wrong: the first scan at which the estimate left the truth, or the scan left the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.filter.step_table import Columns, column, updates
from eval.outcome import LOOP_DEG, LOOP_M
from eval.trajectory.association import AssociationError, associate
from eval.trajectory.errors import pair_errors, stretches
from eval.trajectory.relations import Relations, relation_error
from eval.trajectory.trajectory import Trajectory
from eval.wording import length
from slam.se2 import Pose, between, compose

BAD_M, BAD_DEG = 0.15, 5.0
"""A metre of path is bad if the estimate's motion over it is wrong by more than either."""
BAD_MATCHED_SHARE = 0.5
"""Without truth: a scan is bad if less than this part of the run's usual share of beams met the map's walls …"""
BAD_FAILURE_SHARE = 0.5
"""… or scan matching failed for more than this share of the particles."""


@dataclass(frozen=True, eq=False)
class Failure:
    """The first bad scan, or the worst one where none is bad."""

    scan: int
    since: int
    """Scan from which on the motion is wrong; `scan` itself where that is unknown."""
    stamp: float
    """[s]"""
    bad: bool
    reason: str
    """A sentence with the numbers."""
    estimated: Pose
    """Estimated pose, (3,): in the frame of the truth, aligned with it at `since`; without truth in the map's frame."""
    true_pose: Pose | None
    """True pose in the same frame, (3,); None if it is unknown."""


def find_failure(
    estimate: Trajectory,
    *,
    truth: Trajectory | None = None,
    relations: Relations | None = None,
    dense: Trajectory | None = None,
    steps: Columns | None = None,
) -> Failure | None:
    """Find the first failure by the truth, else by relations (scored on `dense`), else by how the scans fitted the map.

    estimate: a pose per scan. Relations are used only if they show a failure: the worst of good ones does not mark
    a place. Returns None if there is nothing to judge by.
    """
    if truth is not None:
        return first_bad_stretch(estimate, truth)
    found = None if relations is None else first_bad_relation(estimate, dense or estimate, relations)
    if found is None and steps is not None:
        found = first_bad_match(estimate, steps)
    return found


def first_bad_stretch(estimate: Trajectory, truth: Trajectory) -> Failure | None:
    """The scan at the end of the first metre of path whose motion is wrong by more than `BAD_M` or `BAD_DEG`.

    Where there is none, the worst metre. None for paths shorter than a metre, or without a common time.
    """
    try:
        matched = associate(estimate, truth)
    except AssociationError:
        return None
    first, last = stretches(matched, 1.0)
    if len(first) == 0:
        return None
    estimated, true = matched.estimate.poses, matched.reference.poses
    translation, rotation = pair_errors(estimated, true, (first, last))
    severity = np.maximum(translation / BAD_M, rotation / BAD_DEG)
    order = np.argsort(last, kind="stable")
    bad = order[severity[order] > 1.0]
    piece = int(bad[0]) if len(bad) else int(np.argmax(severity))
    start, end = int(first[piece]), int(last[piece])
    wrong = _amount(translation[piece], rotation[piece])
    return Failure(
        scan=int(matched.rows[end]),
        since=int(matched.rows[start]),
        stamp=float(matched.estimate.stamps[end]),
        bad=bool(len(bad)),
        reason=(
            f"over the metre of path before it the estimated motion is wrong by {wrong}"
            if len(bad)
            else f"no metre of the path is wrong by more than {100.0 * BAD_M:.0f} cm or {BAD_DEG:g} degrees; "
            f"this one is the worst, with {wrong}"
        ),
        estimated=compose(true[start], between(estimated[start], estimated[end])),
        true_pose=true[end],
    )


def first_bad_relation(estimate: Trajectory, dense: Trajectory, relations: Relations) -> Failure | None:
    """The scan at which a relation to an earlier one is first wrong by more than `LOOP_M` or `LOOP_DEG`; or None."""
    error = relation_error(dense, relations)
    wrong = (error.translation_errors > LOOP_M) | (error.rotation_errors > LOOP_DEG)
    if not wrong.any():
        return None
    known = error.matched[wrong]
    later = np.maximum(relations.first, relations.second)[known]
    at = int(np.argmin(later))
    one, two = float(relations.first[known[at]]), float(relations.second[known[at]])
    motion = relations.poses[known[at]]
    if one > two:  # the relation looks back in time
        one, two, motion = two, one, between(motion, np.zeros(3))
    before, now = _nearest(dense, one), _nearest(dense, two)
    amount = _amount(error.translation_errors[wrong][at], error.rotation_errors[wrong][at])
    return Failure(
        scan=_nearest(estimate, two),
        since=_nearest(estimate, one),
        stamp=two,
        bad=True,
        reason=f"a hand-checked relation to where it was {two - one:.0f} s before shows that it is off by {amount}",
        estimated=dense.poses[now],
        true_pose=compose(dense.poses[before], motion),
    )


def first_bad_match(estimate: Trajectory, steps: Columns) -> Failure | None:
    """Without truth: the first scan that did not fit the map; where there is none, the one that fitted worst."""
    rows = np.flatnonzero(updates(steps))[1:]  # the first scan meets an empty map
    rows = rows[rows < len(estimate)]
    if len(rows) == 0:
        return None
    share = column(steps, "matched_share")[rows]
    failed = column(steps, "match_failures")[rows] / column(steps, "particles")[rows]
    usual = float(np.nanmedian(share))
    if not usual > 0.0:
        return None
    bad = np.flatnonzero((share < BAD_MATCHED_SHARE * usual) | (failed > BAD_FAILURE_SHARE))
    at = int(bad[0]) if len(bad) else int(np.nanargmin(share))
    numbers = f"{share[at]:.0%} of its beams met walls of the map (usual: {usual:.0%})"
    if failed[at] > 0.0:
        numbers += f", and scan matching failed for {failed[at]:.0%} of the particles"
    return Failure(
        scan=int(rows[at]),
        since=int(rows[at]),
        stamp=float(column(steps, "stamp")[rows[at]]),
        bad=bool(len(bad)),
        reason=numbers if len(bad) else f"every scan fitted the map; this one fitted worst: {numbers}",
        estimated=estimate.poses[rows[at]],
        true_pose=None,
    )


def _nearest(trajectory: Trajectory, stamp: float) -> int:
    """Row of the first of the nearest stamps."""
    return int(np.argmin(np.abs(trajectory.stamps - stamp)))


def _amount(metres: float | NDArray[np.float64], degrees: float | NDArray[np.float64]) -> str:
    return f"{length(float(metres))} and {degrees:.1f} degrees"
