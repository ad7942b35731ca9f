# SPDX-License-Identifier: MIT
"""The figures of a run that matter most, as a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table

HEADLINES = (
    ("trajectory.ate_rmse_m", "trajectory error (ATE)", "{:.3f} m"),
    ("localization.error_median_m", "error in the map's frame, median", "{:.3f} m"),
    ("localization.found_after_m", "found after driving", "{:.1f} m"),
    ("trajectory.heading_rmse_deg", "heading error", "{:.2f} deg"),
    ("trajectory.odometry.ate_rmse_m", "odometry's error (ATE)", "{:.3f} m"),
    ("relations.trans_mean_m", "relations, translation", "{:.4f} m"),
    ("relations.trans_std_m", "relations, translation, std", "{:.4f} m"),
    ("relations.rot_mean_deg", "relations, rotation", "{:.3f} deg"),
    ("relations.pairs", "relations, pairs", "{}"),
    ("map.iou", "map overlap (IoU)", "{:.3f}"),
    ("map.wall_distance_m", "map, wall distance", "{:.3f} m"),
    ("filter.resamplings", "resamplings", "{}"),
    ("realtime_factor", "speed", "{:.1f} x real time"),
)
"""Key in metrics.json, words, format."""


def headline_table(metrics: Mapping[str, Any]) -> Table:
    """The figures of `HEADLINES` that these metrics have."""
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("outcome", f"{metrics['outcome']}")
    if metrics["outcome"] == "lost":
        table.add_row("why", f"{metrics['outcome_reason']}")
    for key, words, form in HEADLINES:
        value: Any = metrics
        for part in key.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        if value is not None:
            table.add_row(words, form.format(value))
    return table
