# SPDX-License-Identifier: MIT
"""Score a run by all measures: one nested dict, the content of `metrics.json`. docs/metrics.md explains each key."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from eval.files.map_server import grid_from_map_file, read_map
from eval.files.trajectory_file import read_trajectory
from eval.files.true_walls import read_true_walls
from eval.files.tum import read_tum
from eval.filter.step_table import Columns
from eval.map.alignment import best_rigid_alignment
from eval.map.error import map_error
from eval.map.grids import cell_centres
from eval.map.lidar_view import LidarView
from eval.map.observability import observable_cells
from eval.map.structure import map_structure
from eval.metrics_json import Metrics, filter_json, map_error_json, plain, relations_json, run_json, trajectory_json
from eval.outcome import Evidence, Outcome, evidence_from_relations, evidence_from_truth, judge
from eval.trajectory.alignment import MIN_POSES
from eval.trajectory.association import Association, AssociationError, associate, covered_share
from eval.trajectory.errors import absolute_error
from eval.trajectory.input_checks import check_pair, check_trajectory
from eval.trajectory.relations import RelationError, Relations, read_relations, relation_error
from eval.trajectory.time_offset import TimeOffset, best_time_offset, find_time_offset
from eval.trajectory.trajectory import Trajectory
from eval.wording import length
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, transform_points, wrap_angle
from worlds.format.map_file import read_map_file

MIN_SHARE = 0.9
"""A smaller share of matched poses, of the path, or of the relations adds a note."""
MISPLACED_M, MISPLACED_DEG = 1.0, 10.0
"""A map whose best fit to the true one moves or turns it by more adds a note."""
ALL_AROUND = LidarView()
"""What a lidar sees of which nothing is known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """What is known to be right; the parts that are unknown are None."""

    trajectory: Trajectory | None = None
    """The true path."""
    relations: Relations | None = None
    """Hand-checked relative poses."""
    grid: OccupancyGrid | None = None
    """The true map: 1 occupied, 0 free, NaN what no lidar can see (`eval.map.grids.grid_from_true_map`)."""
    walls: NDArray[np.float64] | None = None
    """The exact true walls `(x0, y0, x1, y1)` [m], (n, 4), in the frame of `grid` (`worlds.TrueMap.walls`)."""
    lidars: Sequence[LidarView] = ()
    """Fields of view of the lidars: true cells that were never in view are not scored. Empty = lidars unknown: all
    cells in sight of the true path are scored, and a note says so."""
    observable: NDArray[np.bool_] | None = None
    """What `cells_in_sight` gives, for many runs of one drive; None = it is computed for this one."""
    aligns_map: bool = True
    """Whether a map is also scored where it fits the true one best (`map.best_rigid`), which takes the most time."""


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
    """Score a run by all measures that the given data allow; the keys of the others are missing.

    estimate: one pose per scan. odometry: raw, the same stamps; scored as the estimate is, for comparison.
    dense: the estimate at all stamps, which relations are scored on (default: `estimate`). grid: the map.
    steps: the table of the run. ended: why the run did not end by itself, see `eval.outcome.judge`.
    facts: what only the runner knows (seed, wall_s, result_hash, …); copied to the top level.

    The result holds plain numbers, strings, lists and dicts; what cannot be computed is None, never NaN.
    Raises AssociationError or RelationsError where trajectories or relations have no common time.
    """
    metrics: Metrics = {"outcome": "", "outcome_reason": "", **(facts or {})}
    notes = check_trajectory(estimate, "estimate")
    evidence: Evidence | None = None
    matched: Association | None = None
    offset: TimeOffset | None = None
    if reference.relations is not None:
        error = relation_error(dense if dense is not None else estimate, reference.relations)
        metrics["relations"] = relations_json(error)
        evidence = evidence_from_relations(error, reference.relations)
        notes += _relation_notes(error, reference.relations)
    if reference.trajectory is not None:
        matched, offset = _associate(estimate, reference.trajectory)
        covered = covered_share(matched, reference.trajectory)
        metrics["trajectory"] = {**trajectory_json(matched), "covered_share": covered, **_offset_json(offset)}
        evidence = evidence_from_truth(matched, covered)
        notes += [*check_trajectory(reference.trajectory, "truth"), *_association_notes(matched, covered)]
        notes += [f"{_offset_sentence(offset)}: the clocks of estimate and truth differ"] if offset else []
        if odometry is not None:
            metrics["trajectory"]["odometry"] = trajectory_json(associate(odometry, reference.trajectory))
    outcome = _with_time_offset(judge(evidence, ended), offset)
    if grid is not None:
        metrics["map"] = _score_map(grid, reference, matched, outcome, notes)
    if steps is not None:
        metrics |= {**run_json(steps, metrics.get("wall_s")), "filter": filter_json(steps)}
    metrics |= {"outcome": outcome.label, "outcome_reason": outcome.reason, "notes": notes}
    return plain(metrics)  # type: ignore[no-any-return]  # a dict stays a dict


def score_files(
    dataset: str | os.PathLike[str],
    trajectory: str | os.PathLike[str],
    grid: str | os.PathLike[str] | None = None,
    *,
    relations: str | os.PathLike[str] | None = None,
    lidars: Sequence[LidarView] = (),
    time_offset: float | Literal["auto"] = 0.0,
) -> Metrics:
    """Score any system's output against a dataset or run directory (`truth.tum`, `truth_map.yaml`) or a relations file.

    trajectory: one pose per scan or more, as `eval.files.trajectory_file` reads them. grid: map_server `.yaml`. lidars:
    by default those of the run directory. time_offset: added to the trajectory's stamps [s]; `auto` = the constant
    offset that explains its error, where there is one.
    Raises ValueError where the directory holds no truth and no relations are given, and as `score` and the readers.
    """
    folder = Path(dataset)
    truth_file, truth_map_file = folder / "truth.tum", folder / "truth_map.yaml"
    if not truth_file.exists() and relations is None:
        inside = sorted(path.parent for path in folder.glob("*/truth.tum"))
        hint = f"; did you mean {inside[0]}?" if inside else ""
        raise ValueError(f"{folder}: expected truth.tum in it, or a relations file to score against{hint}")
    file = read_map_file(Path(grid)) if grid is not None else None
    truth_map = read_map(truth_map_file) if truth_map_file.exists() else None
    truth = read_tum(truth_file) if truth_file.exists() else None
    estimate, notes = read_estimate(trajectory, truth, time_offset)
    metrics = score(
        estimate,
        reference=Reference(
            trajectory=truth,
            relations=read_relations(relations) if relations is not None else None,
            grid=truth_map,
            walls=read_true_walls(folder, truth_map) if truth_map is not None and grid is not None else None,
            lidars=lidars or _lidars_of_run(folder),
        ),
        grid=grid_from_map_file(file) if file is not None else None,
    )
    return metrics | {"notes": [*notes, *(file.notes if file is not None else ()), *metrics["notes"]]}


def read_estimate(
    path: str | os.PathLike[str], truth: Trajectory | None, time_offset: float | Literal["auto"]
) -> tuple[Trajectory, list[str]]:
    """Read a trajectory, shift its stamps, and return it with notes on both."""
    estimate, read = read_trajectory(path)
    seconds, why_not = _offset_of_auto(estimate, truth) if time_offset == "auto" else (time_offset, [])
    notes = [*read, *why_not]
    if seconds == 0.0:
        return estimate, notes
    return Trajectory(estimate.stamps + seconds, estimate.poses), [*notes, f"{path}: stamps shifted by {seconds:.3f} s"]


def _offset_of_auto(estimate: Trajectory, truth: Trajectory | None) -> tuple[float, list[str]]:
    """The offset that explains an estimate's error [s], else 0 and a note that says why nothing is shifted."""
    nothing = "--time-offset auto has shifted nothing"
    if truth is None:
        return 0.0, [f"{nothing}: there is no true path"]
    found = best_time_offset(estimate, truth)
    if found is None:
        return 0.0, [f"{nothing}: no constant offset lets the estimate and the truth overlap"]
    if found.explains:
        return found.seconds, []
    before = "" if found.error_before is None else f", {length(found.error_before)} without it"
    best = f"the best, {found.seconds:.3f} s, leaves an error of {length(found.error_after)}{before}"
    return 0.0, [f"{nothing}: no constant offset of the clock explains the error ({best})"]


def _lidars_of_run(folder: Path) -> Sequence[LidarView]:
    """Read the lidars that a run was scored with; none where the directory is no finished run or does not say."""
    path = folder / "metrics.json"
    if not path.is_file():
        return ()
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        return [LidarView.from_metrics(stated) for stated in document.get("map", {}).get("lidars", [])]
    except (ValueError, AttributeError, TypeError) as error:
        raise ValueError(f"{path}: map.lidars: {error}") from None


def _associate(estimate: Trajectory, truth: Trajectory) -> tuple[Association, TimeOffset | None]:
    """Match an estimate with the truth; also returns the offset of its clock that explains its error, if there is one.

    Raises AssociationError, with the offset where one is found.
    """
    try:
        matched = associate(estimate, truth)
    except AssociationError as error:
        offset = find_time_offset(estimate, truth)
        raise AssociationError(f"{error} {_offset_sentence(offset)}" if offset else str(error)) from None
    return matched, None if matched.same_stamps else find_time_offset(estimate, truth)


def _offset_sentence(offset: TimeOffset) -> str:
    without = "" if offset.error_before is None else f" instead of {length(offset.error_before)}"
    headings = "" if offset.degrees_before is None else f" instead of {offset.degrees_before:.1f}"
    return (
        f"shifted by {offset.seconds:.3f} s the error is {length(offset.error_after)}{without}, that of the headings "
        f"{offset.degrees_after:.1f}{headings} degrees"
    )


def _offset_json(offset: TimeOffset | None) -> Metrics:
    return {
        "suggested_time_offset_s": offset and offset.seconds,
        "ate_rmse_at_suggested_offset_m": offset and offset.error_after,
    }


def _with_time_offset(outcome: Outcome, offset: TimeOffset | None) -> Outcome:
    """Add to the reason of an outcome that an offset of the clock explains the error."""
    if offset is None:
        return outcome
    return Outcome(outcome.label, f"{outcome.reason}; {_offset_sentence(offset)}")


def _relation_notes(error: RelationError, relations: Relations) -> list[str]:
    if error.unmatched <= (1.0 - MIN_SHARE) * len(relations):
        return [*error.notes]
    return [*error.notes, f"{error.unmatched} of {len(relations)} relations have a stamp that no pose has"]


def _association_notes(matched: Association, covered: float) -> list[str]:
    notes = list(matched.notes)
    if matched.share < MIN_SHARE:
        notes.append(f"only {matched.share:.0%} of the estimate could be compared with the truth")
    if covered < MIN_SHARE:
        notes.append(f"the estimate spans only {covered:.0%} of the true path")
    if len(matched.rows) < MIN_POSES:
        notes.append(f"{len(matched.rows)} matched poses: too few for a meaningful alignment")
    return [*notes, *check_pair(matched)]


def _score_map(
    grid: OccupancyGrid, reference: Reference, matched: Association | None, outcome: Outcome, notes: list[str]
) -> Metrics:
    """Score a map, with the true map where that is known; what a reader must know is appended to `notes`."""
    truth, structure = reference.grid, map_structure(grid)
    metrics: Metrics = {"structure": vars(structure) if structure else None}
    if structure is None:
        notes.append("the map has not one known cell")
    if truth is None:
        return metrics
    alignment, how = np.zeros(3), "none"
    if matched is not None:
        alignment, how = absolute_error(matched, "se2").alignment.T_reference_estimate, "se2"
    observable = _observable(truth, reference, notes)
    notes += _cell_notes(grid, truth)
    metrics |= {
        "alignment": how,
        "observable_cells": int(observable.sum()),
        "lidars": [lidar.metrics for lidar in reference.lidars],
        **map_error_json(map_error(grid, truth, alignment, observable, reference.walls)),
    }
    if not reference.aligns_map:
        return metrics
    best = best_rigid_alignment(grid, truth, alignment)
    moved, turned = _moved(grid, alignment, best), float(np.degrees(wrap_angle(best[2] - alignment[2])))
    notes += _place_notes(moved, turned, outcome)
    best_error = map_error_json(map_error(grid, truth, best, observable, reference.walls))
    return {**metrics, "best_rigid": {"T_truth_map": best, "moved_m": moved, "turned_deg": turned, **best_error}}


def _observable(truth: OccupancyGrid, reference: Reference, notes: list[str]) -> NDArray[np.bool_]:
    """Return the true cells that the lidars could see from the true path, (rows, cols)."""
    if reference.trajectory is None:
        notes.append("no true path: every known cell of the true map counts as observable")
        return truth.known
    observable = reference.observable
    if observable is None:
        observable = cells_in_sight(truth, reference.trajectory, reference.lidars or [ALL_AROUND])
    if not reference.lidars:
        notes.append("the lidar is unknown: every cell in sight of the true path counts as observable")
    if not observable.any():
        notes.append("the true path sees not one cell of the true map: are they in one frame?")
    return observable


def cells_in_sight(truth: OccupancyGrid, path: Trajectory, lidars: Sequence[LidarView]) -> NDArray[np.bool_]:
    """Return the cells of a true map that at least one of the lidars could see from the true path, (rows, cols)."""
    seen = [observable_cells(truth, path.poses, lidar=lidar) for lidar in lidars]
    found: NDArray[np.bool_] = np.logical_or.reduce(seen)
    return found


def _cell_notes(grid: OccupancyGrid, truth: OccupancyGrid) -> list[str]:
    notes = []
    if abs(grid.resolution - truth.resolution) > 1e-9:
        notes.append(f"the map's cells of {grid.resolution:g} m were drawn on the truth's of {truth.resolution:g} m")
    if grid.resolution >= 1.0:
        notes.append(f"the map's cells are {grid.resolution:g} m wide: is its resolution in metres?")
    if abs(wrap_angle(grid.origin[2] - truth.origin[2])) > 1e-9:
        notes.append(
            f"the map's origin is turned by {np.degrees(grid.origin[2]):.4g} degrees: its cells were drawn turned"
        )
    return notes


def _place_notes(moved: float, turned: float, outcome: Outcome) -> list[str]:
    if moved <= MISPLACED_M and abs(turned) <= MISPLACED_DEG:
        return []
    displaced = f"the map is displaced by {moved:.2f} m and {turned:.1f} degrees"
    if outcome.label in ("lost", "broken loop"):
        return [f"{displaced}: expected for the outcome {outcome.label!r}"]
    return [f"{displaced}: map and trajectory may be in different frames"]


def _moved(grid: OccupancyGrid, alignment: Pose, other: Pose) -> float:
    """Return how far the centre of the map's known part moves from one alignment to another [m]."""
    centre = cell_centres(grid, grid.known).mean(axis=0, keepdims=True) if grid.known.any() else np.zeros((1, 2))
    difference = transform_points(other, centre) - transform_points(alignment, centre)
    return float(np.hypot(difference[0, 0], difference[0, 1]))
