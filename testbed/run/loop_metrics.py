# SPDX-License-Identifier: MIT
"""What the final pass found of loops: the group `loops` of `metrics.json` (docs/metrics.md), and for a view."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eval.metrics_json import Metrics
from eval.trajectory.association import AssociationError, associate
from eval.trajectory.trajectory import Trajectory
from slam import se2
from slam.loops import LoopClosing
from slam.se2 import Pose
from testbed.views import FinalLoop


def loop_metrics(closing: LoopClosing, path: Trajectory, truth: Trajectory | None = None) -> Metrics:
    """Convert the loops that the final pass found; path: the filter's, at every frame.

    truth: poses at scans, by which the motions between two visits are judged; None = unknown
    """
    stamps, nodes, distance = path.stamps[closing.frames], path.poses[closing.frames], path.distance[closing.frames]
    true = _true_poses(truth, stamps)
    rows: list[Metrics] = []
    for loop, accepted in zip(closing.loops, closing.accepted.tolist(), strict=True):
        i, j = loop.first, loop.second
        driven, true_motion = se2.between(nodes[i], nodes[j]), se2.between(true[i], true[j])
        gap_m, gap_deg = _difference(driven, loop.pose)
        row = {
            "stamp": float(stamps[j]),
            "seen_before_stamp": float(stamps[i]),
            "length_m": float(distance[j] - distance[i]),
            "accepted": accepted,
            "closed_by_filter": loop.was_closed,
            "gap_m": gap_m,
            "gap_deg": gap_deg,
            "overlap_m": loop.overlap,
            "agreeing_share": loop.agreement.share,
        }
        if np.isfinite(true_motion).all():
            row["filter_error_m"], row["filter_error_deg"] = _difference(driven, true_motion)
            row["match_error_m"], row["match_error_deg"] = _difference(loop.pose, true_motion)
        rows.append(row)
    accepted = [row for row in rows if row["accepted"]]
    return {
        "found": len(rows),
        "accepted": len(accepted),
        "rejected": len(rows) - len(accepted),
        "left_open_by_filter": sum(not row["closed_by_filter"] for row in accepted),
        "path_changed": closing.changed,
        "list": sorted(rows, key=lambda row: row["stamp"]),
    }


def _true_poses(truth: Trajectory | None, stamps: NDArray[np.float64]) -> Pose:
    """True poses at these stamps, (n, 3), interpolated where the truth is known shortly before and after; else NaN."""
    poses = np.full((len(stamps), 3), np.nan)
    if truth is None:
        return poses
    order = np.argsort(truth.stamps, kind="stable")
    found = np.searchsorted(truth.stamps[order], stamps).clip(max=len(order) - 1)
    known = truth.stamps[order][found] == stamps
    poses[known] = truth.poses[order][found][known]
    if known.all():
        return poses
    with suppress(AssociationError):
        matched = associate(Trajectory(stamps[~known], np.zeros((int((~known).sum()), 3))), truth, tolerance=0.0)
        poses[np.flatnonzero(~known)[matched.rows]] = matched.reference.poses
    return poses


def _difference(one: Pose, other: Pose) -> tuple[float, float]:
    """How far two motions (3,) are from each other: [m], [deg]."""
    x, y, theta = se2.between(one, other).tolist()
    return float(np.hypot(x, y)), float(np.degrees(abs(theta)))


def loops_to_show(closing: LoopClosing | None, before: Pose, after: Pose) -> list[FinalLoop]:
    """Return the loops that the final pass found, for a view; before, after: poses at every frame, (frames, 3)."""
    if closing is None:
        return []
    shown = []
    for loop, accepted in zip(closing.loops, closing.accepted.tolist(), strict=True):
        rows = closing.frames[[loop.first, loop.second]]
        closed: Literal["closed_by_filter", "left_open"] = "closed_by_filter" if loop.was_closed else "left_open"
        shown.append(FinalLoop(kind=closed if accepted else "rejected", before=before[rows], after=after[rows]))
    return shown
