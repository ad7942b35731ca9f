# SPDX-License-Identifier: MIT
"""All measures of one run as one nested dict: the content of `metrics.json`. docs/metrics.md explains each key."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eval.files.map_server import read_map
from eval.files.tum import read_tum
from eval.filter.health import Columns, column, consistency, filter_health
from eval.map.alignment import best_rigid_alignment
from eval.map.error import TOLERANCES, MapError, map_error
from eval.map.grids import cell_centres
from eval.map.lidar_view import LidarView
from eval.map.observability import observable_cells
from eval.map.structure import map_structure
from eval.outcome import Evidence, evidence_from_relations, evidence_from_truth, judge
from eval.trajectory import input_checks as suspicions
from eval.trajectory.alignment import MIN_POSES
from eval.trajectory.association import Association, associate, covered_share
from eval.trajectory.errors import AbsoluteError, RelativeError, Statistics, absolute_error, drift, relative_error
from eval.trajectory.relations import PairErrors, RelationError, Relations, read_relations, relation_error
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, transform_points, wrap_angle

RPE_LENGTHS = (1.0, 5.0, 20.0, 50.0)
"""Pieces of path for the relative error [m]."""
RPE_TIMES = (1.0, 10.0, 60.0)
"""Pieces of time for the relative error [s]."""
LOW_SHARE = 0.9
"""Below this share of matched poses, of the path, or of the relations the result says so in its notes."""

ASTRAY_M, ASTRAY_DEG = 1.0, 10.0
"""A map that must be moved or turned by more to fit is told to lie beside its trajectory."""

ALL = LidarView()
"""Stands for a lidar that is unknown."""

Metrics = dict[str, Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """What is known to be right; the parts that are unknown are None."""

    trajectory: Trajectory | None = None
    """The true path."""
    relations: Relations | None = None
    """Hand-checked relative poses."""
    grid: OccupancyGrid | None = None
    """The true map: 1 occupied, 0 free, NaN what no lidar can see (`eval.map.grids.grid_from_true_map`)."""
    lidars: Sequence[LidarView] = ()
    """What the lidars see: true cells that were never in their view are asked of no map. None of them = unknown:
    everything in sight of the true path counts, which the notes say."""


def score(
    estimate: Trajectory,
    *,
    reference: Reference,
    odometry: Trajectory | None = None,
    dense: Trajectory | None = None,
    grid: OccupancyGrid | None = None,
    steps: Columns | None = None,
    ended: str | None = None,
    facts: Mapping[str, Any] | None = None,
) -> Metrics:
    """Score a run by all measures that what is given allows; the keys of the others are missing.

    estimate: one pose per scan. odometry: raw, the same stamps; scored as the estimate is, for comparison.
    dense: the estimate at all stamps, which relations are scored on (default: `estimate`). grid: the map.
    steps: the table of the run. ended: why the run did not end by itself, see `eval.outcome.judge`.
    facts: what only the runner knows (seed, wall_s, result_hash, …), goes into the top level as it is.

    The result holds plain numbers, strings, lists and dicts; what cannot be computed is None, never NaN.
    Raises AssociationError, RelationsError where trajectories or relations do not meet in time.
    """
    notes = suspicions.of_trajectory(estimate, "estimate")
    metrics: Metrics = {"outcome": "", "outcome_reason": "", **(facts or {})}
    evidence: Evidence | None = None
    matched: Association | None = None
    if reference.relations is not None:
        scored = relation_error(dense if dense is not None else estimate, reference.relations)
        metrics["relations"] = _relations_metrics(scored)
        evidence = evidence_from_relations(scored, reference.relations)
        notes += scored.notes
        if scored.unmatched > (1.0 - LOW_SHARE) * len(reference.relations):
            notes.append(f"{scored.unmatched} of {len(reference.relations)} relations have a stamp that no pose has")
    if reference.trajectory is not None:
        matched = associate(estimate, reference.trajectory)
        covered = covered_share(matched, reference.trajectory)
        metrics["trajectory"] = {**_trajectory_metrics(matched), "covered_share": covered}
        evidence = evidence_from_truth(matched, covered)
        notes += [*suspicions.of_trajectory(reference.trajectory, "truth"), *_association_notes(matched, covered)]
        if odometry is not None:
            metrics["trajectory"]["odometry"] = _trajectory_metrics(associate(odometry, reference.trajectory))
    if grid is not None:
        metrics["map"] = _map_metrics(grid, reference, matched, notes)
    if steps is not None:
        metrics.update(_run_metrics(steps, metrics))
        metrics["filter"] = _filter_metrics(steps)
    outcome = judge(evidence, ended)
    metrics |= {"outcome": outcome.label, "outcome_reason": outcome.reason, "notes": notes}
    return _plain(metrics)  # type: ignore[no-any-return]  # a dict stays a dict


def score_files(
    dataset: str | os.PathLike[str],
    trajectory: str | os.PathLike[str],
    grid: str | os.PathLike[str] | None = None,
    *,
    relations: str | os.PathLike[str] | None = None,
    lidars: Sequence[LidarView] = (),
) -> Metrics:
    """Score any system's output against a dataset or run directory (`truth.tum`, `truth_map.yaml`) or a relations file.

    trajectory: TUM, one pose per scan or more. grid: map_server `.yaml`. lidars: by default those of the run, where the
    directory is one.
    Raises ValueError where the directory holds no truth and no relations are given, and as `score` and the readers.
    """
    folder = Path(dataset)
    truth_file, truth_map_file = folder / "truth.tum", folder / "truth_map.yaml"
    if not truth_file.exists() and relations is None:
        raise ValueError(f"{folder}: expected truth.tum in it, or a relations file to score against")
    estimate = read_tum(trajectory)
    return score(
        estimate,
        reference=Reference(
            trajectory=read_tum(truth_file) if truth_file.exists() else None,
            relations=read_relations(relations) if relations is not None else None,
            grid=read_map(truth_map_file) if truth_map_file.exists() else None,
            lidars=lidars or _lidars_of_run(folder),
        ),
        grid=read_map(grid) if grid is not None else None,
    )


def _lidars_of_run(folder: Path) -> Sequence[LidarView]:
    """The lidars that a run was scored with; none where the directory is no finished run or does not say."""
    path = folder / "metrics.json"
    if not path.is_file():
        return ()
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        return [LidarView.from_metrics(stated) for stated in document.get("map", {}).get("lidars", [])]
    except (ValueError, AttributeError, TypeError) as error:
        raise ValueError(f"{path}: map.lidars: {error}") from None


def _trajectory_metrics(matched: Association) -> Metrics:
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
    """Under its names; all None where the error means nothing: one or two poses fit whatever they are."""
    of_distance = (("rmse", "rmse"), ("mean", "mean"), ("median", "median"), ("p95", "p95"), ("max", "maximum"))
    of_heading = (("rmse", "rmse"), ("mean", "mean"), ("max", "maximum"))
    return {
        **{f"{distance}_{name}_m": error and getattr(error.translation, key) for name, key in of_distance},
        **{f"{heading}_{name}_deg": error and getattr(error.rotation, key) for name, key in of_heading},
    }


def _relative(error: RelativeError) -> Metrics:
    t, r = error.translation, error.rotation
    return {
        "trans_rmse_m": t.rmse,
        "trans_mean_m": t.mean,
        "trans_max_m": t.maximum,
        "rot_rmse_deg": r.rmse,
        "rot_mean_deg": r.mean,
        "rot_max_deg": r.maximum,
        "pieces": t.count,
    }


def _association_notes(matched: Association, covered: float) -> list[str]:
    notes = list(matched.notes)
    if matched.share < LOW_SHARE:
        notes.append(f"only {matched.share:.0%} of the estimate could be compared with the truth")
    if covered < LOW_SHARE:
        notes.append(f"the estimate spans only {covered:.0%} of the true path")
    if len(matched.rows) < MIN_POSES:
        notes.append(f"{len(matched.rows)} matched poses: too few for an alignment that means anything")
    return [*notes, *suspicions.of_pair(matched)]


def _relations_metrics(error: RelationError) -> Metrics:
    return {
        **_pairs(error.all),
        "unmatched": error.unmatched,
        "covered_share": error.covered,
        "tolerance_s": error.tolerance,
        "short": _pairs(error.short) if error.short else None,
        "loops": _pairs(error.loops) if error.loops else None,
    }


def _pairs(errors: PairErrors) -> Metrics:
    def four(name: str, unit: str, s: Statistics, squared: Statistics) -> Metrics:
        return {
            f"{name}_mean_{unit}": s.mean,
            f"{name}_std_{unit}": s.std,
            f"{name}_median_{unit}": s.median,
            f"{name}_p95_{unit}": s.p95,
            f"{name}_max_{unit}": s.maximum,
            f"{name}_sq_mean_{unit}2": squared.mean,
            f"{name}_sq_std_{unit}2": squared.std,
        }

    return {
        **four("trans", "m", errors.translation, errors.translation_squared),
        **four("rot", "deg", errors.rotation, errors.rotation_squared),
        "pairs": errors.translation.count,
        "failure_rate": errors.failure_share,
    }


def _map_metrics(grid: OccupancyGrid, reference: Reference, matched: Association | None, notes: list[str]) -> Metrics:
    truth = reference.grid
    structure = map_structure(grid)
    metrics: Metrics = {"structure": vars(structure) if structure else None}
    if structure is None:
        notes.append("the map has not one known cell")
    if truth is None:
        return metrics
    if matched is None:
        alignment, observable, how = np.zeros(3), truth.known, "none"
        notes.append("no true path: every known cell of the true map counts as observable")
    else:
        alignment, how = absolute_error(matched, "se2").alignment.T_reference_estimate, "se2"
        assert reference.trajectory is not None
        seen = [observable_cells(truth, reference.trajectory.poses, lidar=lidar) for lidar in reference.lidars or [ALL]]
        observable = np.logical_or.reduce(seen)
        if not reference.lidars:
            notes.append("the lidar is unknown: every cell in sight of the true path counts as observable")
        if not observable.any():
            notes.append("the true path sees not one cell of the true map: are they in one frame?")
    best = best_rigid_alignment(grid, truth, alignment)
    moved, turned = _moved(grid, alignment, best), float(np.degrees(wrap_angle(best[2] - alignment[2])))
    notes += _map_notes(grid, truth, moved, turned)
    return {
        **metrics,
        "alignment": how,
        "observable_cells": int(observable.sum()),
        "lidars": [lidar.metrics for lidar in reference.lidars],
        **_map_error_metrics(map_error(grid, truth, alignment, observable)),
        "best_rigid": {
            "T_truth_map": best,
            "moved_m": moved,
            "turned_deg": turned,
            **_map_error_metrics(map_error(grid, truth, best, observable)),
        },
    }


def _map_notes(grid: OccupancyGrid, truth: OccupancyGrid, moved: float, turned: float) -> list[str]:
    notes = []
    if abs(grid.resolution - truth.resolution) > 1e-9:
        notes.append(f"the map's cells of {grid.resolution:g} m were drawn on the truth's of {truth.resolution:g} m")
    if grid.resolution >= 1.0:
        notes.append(f"the map's cells are {grid.resolution:g} m wide: is its resolution in metres?")
    if abs(wrap_angle(grid.origin[2] - truth.origin[2])) > 1e-9:
        notes.append(
            f"the map's origin is turned by {np.degrees(grid.origin[2]):.4g} degrees: its cells were drawn turned"
        )
    if moved > ASTRAY_M or abs(turned) > ASTRAY_DEG:
        notes.append(
            f"the map fits the true one best when moved by {moved:.2f} m and turned by {turned:.1f} degrees: "
            "is it in the frame of the trajectory?"
        )
    return notes


def _moved(grid: OccupancyGrid, alignment: Pose, other: Pose) -> float:
    """How far the known part of a map moves from one alignment to another, at its centre [m]."""
    centre = cell_centres(grid, grid.known).mean(axis=0, keepdims=True) if grid.known.any() else np.zeros((1, 2))
    way = transform_points(other, centre) - transform_points(alignment, centre)
    return float(np.hypot(way[0, 0], way[0, 1]))


def _map_error_metrics(error: MapError) -> Metrics:
    metrics: Metrics = {}
    for cells, occupied, free in zip(TOLERANCES, error.occupied, error.free, strict=True):
        suffix = f"_{cells}_cells" if cells else ""
        metrics |= {f"iou{suffix}": occupied.iou, f"f1{suffix}": occupied.f1}
        metrics |= {f"free_iou{suffix}": free.iou, f"free_f1{suffix}": free.f1}
    metrics |= {"precision": error.occupied[0].precision, "recall": error.occupied[0].recall}
    metrics["wall_distance_m"] = error.wall_distance
    for name, distance in (("to_truth", error.to_truth), ("from_truth", error.from_truth)):
        metrics[f"wall_distance_{name}"] = (
            {"mean_m": distance.mean, "trimmed_mean_m": distance.trimmed_mean, "p95_m": distance.p95}
            if distance
            else None
        )
    profile, probability = error.profile, error.probability
    metrics |= {
        "double_wall_rate": profile.double_rate if profile else None,
        "missing_wall_rate": profile.missing_rate if profile else None,
        "wall_thickness_m": profile.thickness if profile else None,
        "true_wall_thickness_m": profile.true_thickness if profile else None,
        "log_loss": probability.log_loss if probability else None,
        "brier": probability.brier if probability else None,
        "auc": probability.auc if probability else None,
        "calibration_error": probability.calibration_error if probability else None,
        "calibration": [vars(part) for part in probability.calibration] if probability else None,
        "coverage": error.coverage,
    }
    return metrics


def _run_metrics(steps: Columns, facts: Metrics) -> Metrics:
    """Counts and times of the whole run, from the table of steps."""
    stamps, on = column(steps, "stamp"), column(steps, "updated") == 1.0
    particles, seconds = column(steps, "particles"), float(np.nansum(column(steps, "filter_s")))
    duration, wall = float(np.ptp(stamps)) if len(stamps) else 0.0, facts.get("wall_s")
    count = int(on.sum())
    return {
        "particles": int(particles[-1]) if len(particles) else 0,
        "scans": len(stamps),
        "updates": count,
        "particle_updates": int(particles[on].sum()),
        "mean_particles": float(particles[on].mean()) if count else None,
        "duration_s": duration,
        "realtime_factor": duration / wall if wall else None,
        "filter_s": seconds,
        "us_per_update_per_particle": 1e6 * seconds / particles[on].sum() if count else None,
        "map_bytes_per_particle": float(np.nanmax(column(steps, "map_bytes") / particles)) if len(stamps) else None,
    }


def _filter_metrics(steps: Columns) -> Metrics | None:
    health, honest = filter_health(steps), consistency(steps)
    if health is None:
        return None
    return {**vars(health), "consistency": vars(honest) if honest else None}


def _plain(value: Any) -> Any:
    """The same with plain Python types, NaN and infinity as None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
