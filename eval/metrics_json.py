# SPDX-License-Identifier: MIT
"""Results of `eval` as the tables of `metrics.json`; docs/metrics.md explains each key.

A field of a result keeps its name as a key; its unit, and what was measured, are added where they are missing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from eval.filter.health import filter_health
from eval.filter.nees import consistency
from eval.filter.step_table import Columns, column, updates
from eval.map.error import TOLERANCES, MapError
from eval.trajectory.alignment import MIN_POSES
from eval.trajectory.association import Association
from eval.trajectory.errors import AbsoluteError, RelativeError, absolute_error, drift, relative_error
from eval.trajectory.relations import PairErrors, RelationError

RPE_LENGTHS = (1.0, 5.0, 20.0, 50.0)
"""Pieces of path for the relative error [m]."""
RPE_TIMES = (1.0, 10.0, 60.0)
"""Pieces of time for the relative error [s]."""

Metrics = dict[str, Any]


def trajectory_json(matched: Association) -> Metrics:
    """Measure a trajectory against the truth; absolute errors are None below `MIN_POSES`, where any two paths fit."""
    aligned, first = absolute_error(matched, "se2"), absolute_error(matched, "first_pose")
    lengths = [(f"{length:g}m", relative_error(matched, length, "m")) for length in RPE_LENGTHS]
    times = [(f"{seconds:g}s", relative_error(matched, seconds, "s")) for seconds in RPE_TIMES]
    found = drift(matched, RPE_LENGTHS)
    return {
        "alignment": "se2",
        "association": matched.method,
        "poses": len(matched.rows),
        "matched_share": matched.share,
        "length_m": float(matched.reference.distance[-1]),
        **_absolute(aligned if len(matched.rows) >= MIN_POSES else None, "ate", "heading"),
        **_absolute(first, "ate_first_pose", "heading_first_pose"),
        "final_error_m": float(first.translation_errors[-1]),
        "rpe": {name: _relative(error) for name, error in lengths + times if error is not None},
        "drift_percent": found.translation_percent if found else None,
        "drift_deg_per_m": found.rotation_deg_per_m if found else None,
        "T_truth_estimate": aligned.alignment.T_reference_estimate,
    }


def _absolute(error: AbsoluteError | None, distance: str, heading: str) -> Metrics:
    return {
        **_named(f"{distance}_", error and error.translation, ("rmse", "mean", "median", "p95", "max"), "_m"),
        **_named(f"{heading}_", error and error.rotation, ("rmse", "mean", "max"), "_deg"),
    }


def _relative(error: RelativeError) -> Metrics:
    return {
        **_named("trans_", error.translation, ("rmse", "mean", "max"), "_m"),
        **_named("rot_", error.rotation, ("rmse", "mean", "max"), "_deg"),
        "pieces": error.translation.count,
    }


def relations_json(error: RelationError) -> Metrics:
    """Convert a score against hand-checked relations."""
    return {
        **_pairs(error.all),
        "unmatched": error.unmatched,
        "covered_share": error.covered,
        "tolerance_s": error.tolerance,
        "short": _pairs(error.short) if error.short else None,
        "loops": _pairs(error.loops) if error.loops else None,
    }


def _pairs(errors: PairErrors) -> Metrics:
    plain, squared = ("mean", "std", "median", "p95", "max"), ("mean", "std")
    return {
        **_named("trans_", errors.translation, plain, "_m"),
        **_named("trans_sq_", errors.translation_squared, squared, "_m2"),
        **_named("rot_", errors.rotation, plain, "_deg"),
        **_named("rot_sq_", errors.rotation_squared, squared, "_deg2"),
        "pairs": errors.translation.count,
        "failure_rate": errors.failure_share,
    }


def map_error_json(error: MapError) -> Metrics:
    """Convert the error of a map under one alignment."""
    metrics: Metrics = {}
    for cells, occupied, free in zip(TOLERANCES, error.occupied, error.free, strict=True):
        suffix = f"_{cells}_cells" if cells else ""
        metrics |= _named("", occupied, ("iou", "f1"), suffix) | _named("free_", free, ("iou", "f1"), suffix)
    distances = ("mean", "trimmed_mean", "p95")
    walls = ("double_wall_rate", "missing_wall_rate", "wall_thickness_m", "true_wall_thickness_m")
    return {
        **metrics,
        **_named("", error.occupied[0], ("precision", "recall")),
        "wall_distance_m": error.wall_distance,
        "wall_distance_to_truth": error.to_truth and _named("", error.to_truth, distances, "_m"),
        "wall_distance_from_truth": error.from_truth and _named("", error.from_truth, distances, "_m"),
        **_named("", error.profile, walls),
        **_named("", error.exact_walls, ("walls_within_cell_rate", "wall_distance_subcell_m")),
        **_named("", error.probability, ("log_loss", "brier", "auc", "calibration_error")),
        "calibration": error.probability and [vars(part) for part in error.probability.calibration],
        "coverage": error.coverage,
    }


def run_json(steps: Columns, wall_s: float | None) -> Metrics:
    """Count and time a whole run from its table of steps; `wall_s` is its wall time [s]."""
    stamps, particles, on = column(steps, "stamp"), column(steps, "particles"), updates(steps)
    seconds = float(np.nansum(column(steps, "filter_s")))
    duration = float(np.ptp(stamps)) if len(stamps) else 0.0
    count = int(on.sum())
    return {
        "particles": int(particles[-1]) if len(particles) else 0,
        "scans": len(stamps),
        "updates": count,
        "particle_updates": int(particles[on].sum()),
        "mean_particles": float(particles[on].mean()) if count else None,
        "duration_s": duration,
        "realtime_factor": duration / wall_s if wall_s else None,
        "filter_s": seconds,
        "us_per_update_per_particle": 1e6 * seconds / particles[on].sum() if count else None,
        "map_bytes_per_particle": float(np.nanmax(column(steps, "map_bytes") / particles)) if len(stamps) else None,
    }


def filter_json(steps: Columns) -> Metrics | None:
    """Measure the filter from the table of steps; None where it took no scan in."""
    health, found = filter_health(steps), consistency(steps)
    return None if health is None else {**vars(health), "consistency": found and vars(found)}


def plain(value: Any) -> Any:
    """Return the same content as plain Python types, with None for NaN and infinity."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _named(prefix: str, result: object | None, fields: Iterable[str], suffix: str = "") -> Metrics:
    """Return some fields of a result with a prefix and a suffix on their names; all are None without a result."""
    return {f"{prefix}{field}{suffix}": None if result is None else getattr(result, field) for field in fields}
