# SPDX-License-Identifier: MIT
"""Assign one outcome label per run, by stated rules. Report the failure rate with every mean: means hide failures.

The rules judge errors of motions, not absolute errors. They therefore need no alignment, and are the same for simulated
runs (motions of the truth) and recorded ones (hand-checked relations). They look at short stretches first, then at
pairs of visits to one place, then at the whole path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eval.trajectory.association import Association
from eval.trajectory.errors import Pairs, absolute_error, pair_errors, stretches
from eval.trajectory.relations import MAX_SHORT, RelationError, Relations

Label = Literal["ok", "drift", "broken loop", "lost", "collided", "timeout", "interrupted", "failed", "unjudged"]
Ended = Literal["collided", "timeout", "interrupted", "failed"]

LOCAL_M, LOCAL_DEG = 0.5, 20.0
"""The motion over one metre of path is bad if it is wrong by more than either."""
LOCAL_PATH = 0.5
"""A run is `lost` if bad metres begin on more than this length of path [m]. A jump spoils every metre that contains it,
noise of a single pose does not."""
LOCAL_SHARE = 0.005
"""A run with relations is `lost` if more than this share of its short pairs is bad: a few relations may be wrong."""
LOOP_M, LOOP_DEG = 0.3, 10.0
"""A pair of visits to one place is bad if its relative motion is wrong by more than either."""
LOOP_SHARE = 0.05
"""A run is a `broken loop` if more than this share of the pairs of visits is bad."""
COVERED_SHARE = 0.9
"""A run is `lost` if the estimate spans less than this share of the true path, or of the relations."""
MIN_JUDGED_POSES, MIN_JUDGED_SHARE = 5, 0.05
"""A run is `unjudged` with fewer matched poses, or if the estimate spans less than this share of the path."""
DRIFT_M = 0.15
"""A run that is neither is `drift` if its ATE rmse (with relations: median error) is above this [m]."""
MIN_LOOP_POSES = 200
"""Fewer candidate poses are not thinned out further when pairs of visits are looked for."""
_ENDS: dict[str, str] = {
    "collided": "the robot ran into something and could not go on",
    "timeout": "the time limit was reached before the robot had reached its goal",
    "interrupted": "the run was stopped by hand",
    "failed": "the run ended with an error",
}


@dataclass(frozen=True)
class Outcome:
    """A label and a sentence with the reason and its numbers."""

    label: Label
    reason: str


@dataclass(frozen=True, eq=False)
class Evidence:
    """The errors by which an outcome is judged."""

    local: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Errors of motions over short stretches [m] and [deg], two arrays (n,)."""
    local_weights: NDArray[np.float64]
    """Weight of each stretch, (n,): metres of path on which it begins, or its share of the relations."""
    local_limit: float
    """Largest sum of weights of bad stretches that is accepted, in the unit of the weights."""
    loops: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Errors of motions between visits to one place [m] and [deg], two arrays (k,)."""
    whole_m: float
    """Error of the whole path [m]."""
    whole_name: str
    """Name of the measure in `whole_m`."""
    poses: int | None = None
    """Number of matched poses; None = judged by relations."""
    covered: float = 1.0
    """Share of the true path, or of the relations, that the estimate spans, 0 to 1."""


def evidence_from_truth(matched: Association, covered: float = 1.0) -> Evidence:
    """Collect the evidence of a run with known truth: stretches of one metre, and `loop_pairs` for the visits.

    covered: see `eval.trajectory.association.covered_share`.
    """
    estimate, truth = matched.estimate.poses, matched.reference.poses
    pairs = stretches(matched, 1.0)
    path = matched.reference.distance
    return Evidence(
        local=pair_errors(estimate, truth, pairs),
        local_weights=np.diff(path, append=path[-1])[pairs[0]],
        local_limit=LOCAL_PATH,
        loops=pair_errors(estimate, truth, loop_pairs(matched)),
        whole_m=absolute_error(matched, "se2").translation.rmse,
        whole_name="ATE rmse",
        poses=len(matched.rows),
        covered=covered,
    )


def evidence_from_relations(error: RelationError, relations: Relations) -> Evidence:
    """Collect the evidence of a recorded run from hand-checked relations.

    Trap: short relations often do not overlap. One jump then spoils at most one of them, and shows as a broken loop.
    """
    apart = np.abs(relations.second - relations.first)[error.matched]
    short = apart <= MAX_SHORT
    return Evidence(
        local=(error.translation_errors[short], error.rotation_errors[short]),
        local_weights=np.full(int(short.sum()), 1.0 / max(int(short.sum()), 1)),
        local_limit=LOCAL_SHARE,
        loops=(error.translation_errors[~short], error.rotation_errors[~short]),
        whole_m=error.all.translation.median,
        whole_name="median relation error",
        covered=error.covered,
    )


def judge(evidence: Evidence | None, ended: str | None = None) -> Outcome:
    """Return the outcome of a run: the reason why it ended early, else the first rule of this module that it breaks.

    ended: one of `collided`, `timeout`, `interrupted`, `failed`; None = it ran to its end.
    """
    if ended is not None:
        if ended not in _ENDS:
            raise ValueError(f"ended: expected one of {', '.join(_ENDS)} or None, got {ended!r}")
        return Outcome(ended, _ENDS[ended])  # type: ignore[arg-type]  # the keys are labels
    if evidence is None:
        return Outcome("unjudged", "there is no truth and no relation to judge it by")
    if evidence.poses is not None and evidence.poses < MIN_JUDGED_POSES:
        return Outcome("unjudged", f"{evidence.poses} matched poses, expected {MIN_JUDGED_POSES} or more to judge by")
    if evidence.covered < MIN_JUDGED_SHARE:
        return Outcome("unjudged", f"the estimate spans only {evidence.covered:.1%} of what is known of the path")
    return _first_rule(evidence)


def _first_rule(evidence: Evidence) -> Outcome:
    """Return the label of the first rule that a complete run breaks."""
    if evidence.covered < COVERED_SHARE:
        return Outcome("lost", f"the estimate spans only {evidence.covered:.0%} of what is known of the path")
    bad = _bad(evidence.local, LOCAL_M, LOCAL_DEG)
    weight = float(evidence.local_weights[bad].sum())
    if weight > evidence.local_limit:
        return Outcome("lost", _local_reason(weight, by_relations=evidence.poses is None))
    bad = _bad(evidence.loops, LOOP_M, LOOP_DEG)
    if len(bad) and bad.mean() > LOOP_SHARE:
        return Outcome(
            "broken loop",
            f"{bad.mean():.0%} of the visits to known places do not meet the earlier ones "
            f"(worst: {_worst(evidence.loops)})",
        )
    whole = f"{evidence.whole_name} {evidence.whole_m:.3f} m"
    if evidence.whole_m > DRIFT_M:
        return Outcome("drift", f"no stretch or loop of the path is broken, but {whole} is above {DRIFT_M} m")
    loops = "every loop closes" if len(evidence.loops[0]) else "no place was visited twice"
    return Outcome("ok", f"no stretch of the path is broken, {loops}, {whole}")


def _local_reason(weight: float, *, by_relations: bool) -> str:
    """Say on how much of the path, or of the short relations, the motion is bad: no largest error, of which a report
    has another one for each length."""
    if by_relations:
        bad = f"the motion over {weight:.1%} of the relations up to {MAX_SHORT:.0f} s apart"
    else:
        bad = f"on {weight:.1f} m of the path the estimate's motion over the next metre"
    return f"{bad} is wrong by more than {LOCAL_M} m or {LOCAL_DEG:.0f} degrees"


def loop_pairs(
    matched: Association, *, radius: float = 1.0, min_path: float = 10.0, spacing: float = 0.25, max_pairs: int = 20_000
) -> Pairs:
    """Return pairs of rows at which the reference visits one place twice, two arrays (k,).

    Candidates are poses `spacing` [m] of path apart. Two of them are a pair if their positions lie within `radius` [m]
    and at least `min_path` [m] of path lie between. The spacing is doubled until at most `max_pairs` pairs, or fewer
    than `MIN_LOOP_POSES` candidates, are left.
    """
    poses, path = matched.reference.poses, matched.reference.distance
    while True:
        rows = np.flatnonzero(np.diff(np.floor(path / spacing), prepend=-1.0) > 0)
        tree = cKDTree(poses[rows, :2])
        if tree.count_neighbors(tree, radius) <= 2 * max_pairs or len(rows) < MIN_LOOP_POSES:
            break
        spacing *= 2.0
    pairs = tree.query_pairs(radius, output_type="ndarray").reshape(-1, 2)
    first, last = rows[pairs.min(axis=1)], rows[pairs.max(axis=1)]
    far = path[last] - path[first] >= min_path
    return first[far], last[far]


def _bad(errors: tuple[NDArray[np.float64], NDArray[np.float64]], metres: float, degrees: float) -> NDArray[np.bool_]:
    """Return which errors are above either limit, (n,)."""
    return (errors[0] > metres) | (errors[1] > degrees)


def _worst(errors: tuple[NDArray[np.float64], NDArray[np.float64]]) -> str:
    return f"{errors[0].max():.2f} m, {errors[1].max():.1f} degrees"
