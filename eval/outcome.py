# SPDX-License-Identifier: MIT
"""One word for how a run went, by stated rules: means over runs hide failures, so a rate of them goes beside.

The rules look at errors of motions, not at absolute errors, so they need no alignment and are the same for simulated
runs (motions of the truth) and recorded ones (hand-checked relations): first over short stretches, then between
visits of one place, then of the whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from eval.trajectory.association import Association
from eval.trajectory.errors import Pairs, absolute_error, pair_errors, stretches
from eval.trajectory.relations import SHORT, RelationError, Relations

Label = Literal["ok", "drift", "broken loop", "lost", "collided", "timeout", "interrupted", "failed", "unjudged"]
Ended = Literal["collided", "timeout", "interrupted", "failed"]

LOCAL_M, LOCAL_DEG = 0.5, 20.0
"""`lost`: the motion over a metre of path is wrong by more than either …"""
LOCAL_PATH = 0.5
"""… from this much of the path on [m] (a jump spoils every metre that straddles it, noise of one pose does not) …"""
LOCAL_SHARE = 0.005
"""… or, with relations, in over 0.5 % of the short pairs: a few of them may be wrong themselves."""
LOOP_M, LOOP_DEG = 0.3, 10.0
"""`broken loop`: an error above either in over 5 % of the pairs of visits to one place."""
LOOP_SHARE = 0.05
COVERED_SHARE = 0.9
"""`lost`, too: the estimate spans less than this of the true path, or of the relations."""
DRIFT_M = 0.15
"""`drift`: neither, but an ATE rmse (relations: a median error) above this."""
_ENDS: dict[str, str] = {
    "collided": "the robot ran into something and could not go on",
    "timeout": "the time allowed was over before the robot had reached its goal",
    "interrupted": "the run was stopped by hand",
    "failed": "the run broke off with an error",
}


@dataclass(frozen=True)
class Outcome:
    """A label and the sentence that gives the reason, with its numbers."""

    label: Label
    reason: str


@dataclass(frozen=True, eq=False)
class Evidence:
    """Errors that an outcome is judged by."""

    local: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Of motions over short stretches [m] and [deg], two arrays (n,)."""
    local_weights: NDArray[np.float64]
    """What each of them counts, (n,): metres of path that it begins on, or its share of the relations."""
    local_limit: float
    """Sum of the weights that may be bad."""
    loops: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Of motions between visits of one place, likewise."""
    whole_m: float
    whole_name: str
    """What `whole_m` is, in words."""
    covered: float = 1.0
    """Share of the true path, or of the relations, that the estimate spans, 0 to 1."""


def evidence_from_truth(matched: Association, covered: float = 1.0) -> Evidence:
    """Evidence of a run with known truth: path pieces of one metre, and `loop_pairs` for the visits.

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
        covered=covered,
    )


def evidence_from_relations(error: RelationError, relations: Relations) -> Evidence:
    """Evidence of a recorded run.

    Trap: short relations often do not overlap, so one jump spoils one of them at most and shows as a broken loop.
    """
    apart = np.abs(relations.second - relations.first)[error.matched]
    short = apart <= SHORT
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
    """The outcome of a run: why it ended if not by itself, else the first rule of the module that it breaks.

    ended: one of `collided`, `timeout`, `interrupted`, `failed`; None = it ran to its end.
    """
    if ended is not None:
        if ended not in _ENDS:
            raise ValueError(f"ended: expected one of {', '.join(_ENDS)} or None, got {ended!r}")
        return Outcome(ended, _ENDS[ended])  # type: ignore[arg-type]  # the keys are labels
    if evidence is None:
        return Outcome("unjudged", "there is no truth and no relation to judge it by")
    return _first_rule(evidence)


def _first_rule(evidence: Evidence) -> Outcome:
    """The first rule of the module that a run breaks which came to its end."""
    if evidence.covered < COVERED_SHARE:
        return Outcome("lost", f"the estimate spans only {evidence.covered:.0%} of what is known of the path")
    bad = _bad(evidence.local, LOCAL_M, LOCAL_DEG)
    if evidence.local_weights[bad].sum() > evidence.local_limit:
        return Outcome("lost", f"over short stretches the estimate is wrong by up to {_worst(evidence.local)}")
    bad = _bad(evidence.loops, LOOP_M, LOOP_DEG)
    if len(bad) and bad.mean() > LOOP_SHARE:
        return Outcome(
            "broken loop",
            f"{bad.mean():.0%} of the visits to known places do not meet the earlier ones "
            f"(worst: {_worst(evidence.loops)})",
        )
    whole = f"{evidence.whole_name} {evidence.whole_m:.3f} m"
    if evidence.whole_m > DRIFT_M:
        return Outcome("drift", f"every stretch and loop holds, but {whole} is above {DRIFT_M} m")
    loops = "every loop closes" if len(evidence.loops[0]) else "no place was visited twice"
    return Outcome("ok", f"every stretch holds, {loops}, {whole}")


def loop_pairs(
    matched: Association, *, radius: float = 1.0, min_path: float = 10.0, spacing: float = 0.25, limit: int = 20_000
) -> Pairs:
    """Pairs of rows where the reference comes back to a place, two arrays (k,): the relations of a simulated run.

    Poses `spacing` [m] of path apart whose positions lie within `radius` [m], with at least `min_path` [m] travelled
    in between. Where that would be more than about `limit` pairs, the poses are thinned out.
    """
    poses, path = matched.reference.poses, matched.reference.distance
    while True:
        rows = np.flatnonzero(np.diff(np.floor(path / spacing), prepend=-1.0) > 0)
        tree = cKDTree(poses[rows, :2])
        if tree.count_neighbors(tree, radius) <= 2 * limit or len(rows) < 200:
            break
        spacing *= 2.0
    pairs = tree.query_pairs(radius, output_type="ndarray").reshape(-1, 2)
    first, last = rows[pairs.min(axis=1)], rows[pairs.max(axis=1)]
    far = path[last] - path[first] >= min_path
    return first[far], last[far]


def _bad(errors: tuple[NDArray[np.float64], NDArray[np.float64]], metres: float, degrees: float) -> NDArray[np.bool_]:
    """Which of the errors are above either limit, (n,)."""
    return (errors[0] > metres) | (errors[1] > degrees)


def _worst(errors: tuple[NDArray[np.float64], NDArray[np.float64]]) -> str:
    return f"{errors[0].max():.2f} m, {errors[1].max():.1f} degrees"
