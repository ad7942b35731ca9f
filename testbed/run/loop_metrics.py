# SPDX-License-Identifier: MIT
"""What the final pass found of loops: the group `loops` of `metrics.json` (docs/metrics.md), and for a view."""

from __future__ import annotations

from typing import Literal

import numpy as np

from eval.metrics_json import Metrics
from eval.trajectory.trajectory import Trajectory
from slam import se2
from slam.loops import LoopClosing
from slam.se2 import Pose
from testbed.views import FinalLoop


def loop_metrics(closing: LoopClosing, path: Trajectory) -> Metrics:
    """Convert the loops that the final pass found; path: the filter's, at every frame."""
    stamps, nodes, distance = path.stamps[closing.frames], path.poses[closing.frames], path.distance[closing.frames]
    rows: list[Metrics] = []
    for loop, accepted in zip(closing.loops, closing.accepted.tolist(), strict=True):
        i, j = loop.first, loop.second
        gap = se2.between(se2.between(nodes[i], nodes[j]), loop.pose)
        rows.append(
            {
                "stamp": float(stamps[j]),
                "seen_before_stamp": float(stamps[i]),
                "length_m": float(distance[j] - distance[i]),
                "accepted": accepted,
                "closed_by_filter": loop.was_closed,
                "gap_m": float(np.hypot(gap[0], gap[1])),
                "gap_deg": float(np.degrees(abs(gap[2]))),
                "overlap_m": loop.overlap,
                "agreeing_share": loop.agreement.share,
            }
        )
    accepted = [row for row in rows if row["accepted"]]
    return {
        "found": len(rows),
        "accepted": len(accepted),
        "rejected": len(rows) - len(accepted),
        "left_open_by_filter": sum(not row["closed_by_filter"] for row in accepted),
        "path_changed": closing.changed,
        "list": sorted(rows, key=lambda row: row["stamp"]),
    }


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
