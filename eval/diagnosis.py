# SPDX-License-Identifier: MIT
"""Where it went wrong: the first scan at which a run left the truth, or lost touch with its own map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eval.association import AssociationError, associate
from eval.consistency import Columns, column, updates
from eval.trajectory import Trajectory
from eval.trajectory_error import pair_errors, stretches

BAD_M, BAD_DEG = 0.15, 5.0
"""A metre of path is bad if the estimate's motion over it is wrong by more than either."""
BAD_MATCHED_SHARE = 0.5
"""Without truth: a scan is bad if less than this part of the run's usual share of beams met the map's walls …"""
BAD_FAILURE_SHARE = 0.5
"""… or scan matching failed for more than this share of the particles."""


@dataclass(frozen=True)
class Finding:
    """The first bad scan, or the worst one where none is bad."""

    scan: int
    since: int
    """Scan from which on the motion is wrong: one metre of path earlier, or `scan` itself without truth."""
    stamp: float
    """[s]"""
    bad: bool
    reason: str
    """A sentence with the numbers."""


def first_bad_stretch(estimate: Trajectory, truth: Trajectory) -> Finding | None:
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
    translation, rotation = pair_errors(matched.estimate.poses, matched.reference.poses, (first, last))
    severity = np.maximum(translation / BAD_M, rotation / BAD_DEG)
    order = np.argsort(last, kind="stable")
    bad = order[severity[order] > 1.0]
    piece = int(bad[0]) if len(bad) else int(np.argmax(severity))
    row = int(last[piece])
    wrong = f"{100.0 * translation[piece]:.1f} cm and {rotation[piece]:.1f} degrees"
    return Finding(
        scan=int(matched.rows[row]),
        since=int(matched.rows[first[piece]]),
        stamp=float(matched.estimate.stamps[row]),
        bad=bool(len(bad)),
        reason=(
            f"over the metre of path before it the estimated motion is wrong by {wrong}"
            if len(bad)
            else f"no metre of the path is wrong by more than {100.0 * BAD_M:.0f} cm or {BAD_DEG:g} degrees; "
            f"this one is the worst, with {wrong}"
        ),
    )


def first_bad_match(steps: Columns) -> Finding | None:
    """Without truth: the first scan that did not fit the map; where there is none, the one that fitted worst."""
    rows = np.flatnonzero(updates(steps))[1:]  # the first scan meets an empty map
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
    return Finding(
        scan=int(rows[at]),
        since=int(rows[at]),
        stamp=float(column(steps, "stamp")[rows[at]]),
        bad=bool(len(bad)),
        reason=numbers if len(bad) else f"every scan fitted the map; this one fitted worst: {numbers}",
    )
