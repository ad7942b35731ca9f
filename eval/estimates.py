# SPDX-License-Identifier: MIT
"""Scores the three estimates of one run, each by the same measures.

| estimate | what it is | keys in `metrics.json` |
|---|---|---|
| online | the pose that was reported at each scan: what a robot would have driven by | `trajectory_online`, … |
| filter | path and map of the best particle at the end | `trajectory_filter`, `map_filter`, … |
| final | `estimate.tum` and `map`: after the final pass, the filter's without one | `trajectory`, `map`, … |
"""

from __future__ import annotations

from dataclasses import dataclass

from eval.metrics_json import Metrics
from eval.scoring import Reference, score
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid

SCORED = ("outcome", "relations", "trajectory", "map")
"""Keys of `metrics.json` that exist for each estimate, with its name as suffix."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PathAndMap:
    """One estimate of a run."""

    at_scans: Trajectory
    """Poses at all scans."""
    dense: Trajectory | None = None
    """Poses at all frames; None = only those at scans."""
    map: OccupancyGrid | None = None
    """The map of these poses; None = not scored."""


def score_estimate(name: str, estimate: PathAndMap, reference: Reference, ended: str | None) -> Metrics:
    """Measures of one estimate: `outcome_NAME`, `trajectory_NAME`, `relations_NAME`, `map_NAME`.

    The keys within are those of `eval.scoring.score`, without the odometry's. Keys that the references do not allow
    are missing. ended: why the run did not end by itself, see `eval.outcome.judge`.
    """
    metrics = score(estimate.at_scans, reference=reference, dense=estimate.dense, grid=estimate.map, ended=ended)
    return named(name, metrics)


def named(name: str, metrics: Metrics) -> Metrics:
    """The measures of the final estimate under the keys of another one that is equal to it."""
    found = {f"{key}_{name}": metrics[key] for key in SCORED if key in metrics}
    if f"trajectory_{name}" in found:
        found[f"trajectory_{name}"] = {k: v for k, v in metrics["trajectory"].items() if k != "odometry"}
    return found
