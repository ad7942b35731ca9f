# SPDX-License-Identifier: MIT
"""The dict of all measures: right keys, plain values, honest notes, and never a good score by accident."""

import json
import shutil

import numpy as np
import pytest

from eval.files.map_server import read_map, write_map
from eval.files.tum import read_tum, write_tum
from eval.map.lidar_view import LidarView
from eval.scoring import Reference, score, score_files
from eval.trajectory.association import AssociationError
from eval.trajectory.relations import Relations, RelationsError
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from slam.se2 import between, compose
from tests.eval.helpers import moved, noisy, random_walk, room
from tests.eval.synthetic_run import write_run

TRUTH = random_walk(400, 1)


PROMISED = [
    "outcome",
    "seed",
    "particles",
    "scans",
    "updates",
    "particle_updates",
    "mean_particles",
    "duration_s",
    "wall_s",
    "realtime_factor",
    "filter_s",
    "us_per_update_per_particle",
    "peak_rss_mb",
    "map_bytes_per_particle",
    "result_hash",
    "trajectory.ate_rmse_m",
    "trajectory.ate_mean_m",
    "trajectory.ate_first_pose_rmse_m",
    "trajectory.rpe.1m.trans_rmse_m",
    "trajectory.heading_rmse_deg",
    "trajectory.odometry.ate_rmse_m",
    "map.iou",
    "map.f1",
    "map.wall_distance_m",
    "map.double_wall_rate",
    "map.log_loss",
    "map.coverage",
    "map.best_rigid.iou",
    "filter.resamplings",
    "filter.match_failures",
    "filter.mean_ess",
    "filter.consistency.nees_mean",
]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("runs") / "good")


def test_a_run_has_every_measure_that_the_design_promises(run):
    metrics = json.loads((run / "metrics.json").read_text())
    for key in PROMISED:
        value = metrics
        for part in key.split("."):
            value = value[part]
        assert value is not None, key
    assert metrics["outcome"] == "ok"
    assert metrics["trajectory"]["ate_rmse_m"] < 0.1 * metrics["trajectory"]["odometry"]["ate_rmse_m"]
    # 213 updates of 12 ms with 30 particles
    assert metrics["particle_updates"] == 30 * metrics["updates"]
    assert metrics["mean_particles"] == 30.0
    assert metrics["us_per_update_per_particle"] == pytest.approx(12_000.0 / 30)
    assert metrics["realtime_factor"] == pytest.approx(metrics["duration_s"] / 12.3)


def test_scoring_the_files_of_a_run_gives_the_figures_of_the_run(run):
    metrics, again = (
        json.loads((run / "metrics.json").read_text()),
        score_files(run, run / "estimate.tum", run / "map.yaml"),
    )
    assert again["trajectory"]["ate_rmse_m"] == pytest.approx(metrics["trajectory"]["ate_rmse_m"], abs=1e-12)
    for key in ("iou", "wall_distance_m", "double_wall_rate", "coverage"):
        assert again["map"][key] == pytest.approx(metrics["map"][key], abs=2e-3), key
    assert again["map"]["log_loss"] == pytest.approx(metrics["map"]["log_loss"], rel=0.1)  # grey levels


def test_cells_that_no_lidar_looked_at_are_asked_of_no_map(run):
    truth, true_map = read_tum(run / "truth.tum"), read_map(run / "truth_map.yaml")
    ahead, behind = LidarView(first=-0.5, width=1.0, range_max=4.0), LidarView(first=2.6, width=1.0, range_max=4.0)

    def cells(*lidars):
        reference = Reference(trajectory=truth[:160], grid=true_map, lidars=lidars)
        metrics = score(truth[:160], reference=reference, grid=true_map)
        return metrics["map"]["observable_cells"], metrics["notes"], metrics["map"]["lidars"]

    one, two, both = cells(ahead)[0], cells(behind)[0], cells(ahead, behind)[0]
    everything, notes, stated = cells()
    assert max(one, two) < both < everything
    assert both < one + two
    assert stated == []
    assert any("the lidar is unknown" in note for note in notes)
    assert cells(ahead)[1:] == ([], [ahead.metrics])


def test_a_dataset_is_scored_with_the_lidar_of_its_run(run, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    metrics = json.loads((folder / "metrics.json").read_text())
    metrics["map"]["lidars"] = [LidarView(range_max=1.5).metrics]
    (folder / "metrics.json").write_text(json.dumps(metrics))
    near = score_files(folder, folder / "estimate.tum", folder / "map.yaml")["map"]
    assert near["lidars"] == metrics["map"]["lidars"]
    assert near["observable_cells"] < metrics["map"]["observable_cells"]
    (folder / "metrics.json").write_text('{"map": {"lidars": [{}]}}')
    with pytest.raises(ValueError, match=r"metrics\.json: map\.lidars"):
        score_files(folder, folder / "estimate.tum", folder / "map.yaml")


def test_a_moved_estimate_with_its_map_scores_the_same(run):
    T = (3.0, -7.0, 1.0)
    estimate, truth, grid = read_tum(run / "estimate.tum"), read_tum(run / "truth.tum"), read_map(run / "map.yaml")
    reference = Reference(trajectory=truth, grid=read_map(run / "truth_map.yaml"))
    a = score(estimate, reference=reference, grid=grid)
    b = score(Trajectory(estimate.stamps, compose(T, estimate.poses)), reference=reference, grid=moved(grid, T))
    assert a["trajectory"]["ate_rmse_m"] == pytest.approx(b["trajectory"]["ate_rmse_m"], abs=1e-9)
    assert a["map"]["wall_distance_m"] == pytest.approx(b["map"]["wall_distance_m"], abs=1e-6)
    assert a["map"]["iou"] == pytest.approx(b["map"]["iou"], abs=0.01)


def test_a_misplaced_map_differs_from_a_bent_one(run):
    truth, true_map = read_tum(run / "truth.tum"), read_map(run / "truth_map.yaml")
    metrics = score(truth, reference=Reference(trajectory=truth, grid=true_map), grid=moved(true_map, (0.2, 0.1, 0.01)))
    assert metrics["map"]["wall_distance_m"] > 0.1
    assert metrics["map"]["best_rigid"]["wall_distance_m"] < 0.02
    assert metrics["map"]["best_rigid"]["moved_m"] == pytest.approx(np.hypot(0.2, 0.1), abs=0.05)


def test_without_a_reference_nothing_is_scored():
    metrics = score(TRUTH, reference=Reference(), grid=room())
    assert metrics["outcome"] == "unjudged"
    assert "trajectory" not in metrics
    assert set(metrics["map"]) == {"structure"}


def test_doubts_stand_in_the_notes():
    few = TRUTH[:2]
    late = Trajectory(np.r_[TRUTH.stamps, TRUTH.stamps + 1000.0], np.r_[TRUTH.poses, TRUTH.poses])
    centimetres = Trajectory(TRUTH.stamps, TRUTH.poses * [100.0, 100.0, 1.0])
    unknown = OccupancyGrid(probability=np.full((9, 9), np.nan, np.float32), resolution=0.1, origin=(0.0, 0.0, 0.0))
    for estimate, grid, expected in (
        (few, None, "2 matched poses"),
        (late, None, "only 50% of the estimate"),
        (centimetres, None, "metres?"),
        (TRUTH, unknown, "not one known cell"),
        (TRUTH, unknown, "cells of 0.1 m were drawn"),
    ):
        reference = Reference(trajectory=TRUTH, grid=room() if grid is not None else None)
        notes = score(estimate, reference=reference, grid=grid)["notes"]
        assert any(expected in note for note in notes), (expected, notes)
    elsewhere = Reference(trajectory=TRUTH, grid=moved(room(), (1000.0, 0.0, 0.0)))
    assert any("in one frame?" in note for note in score(TRUTH, reference=elsewhere, grid=room())["notes"])


def test_what_cannot_be_computed_is_none_never_nan():
    one = Trajectory(np.array([TRUTH.stamps[0]]), TRUTH.poses[:1])
    unknown = OccupancyGrid(probability=np.full((9, 9), np.nan, np.float32), resolution=0.05, origin=(0.0, 0.0, 0.0))
    metrics = score(one, reference=Reference(trajectory=TRUTH, grid=room()), grid=unknown)
    json.dumps(metrics, allow_nan=False)
    assert metrics["trajectory"]["drift_percent"] is None
    assert metrics["map"]["wall_distance_m"] is None
    assert metrics["map"]["coverage"] in (None, 0.0)


def test_no_common_time_and_no_truth_are_errors(tmp_path):
    with pytest.raises(AssociationError, match="no pose of the estimate"):
        score(Trajectory(TRUTH.stamps + 1e6, TRUTH.poses), reference=Reference(trajectory=TRUTH))
    write_tum(tmp_path / "estimate.tum", TRUTH)
    with pytest.raises(ValueError, match=r"expected truth\.tum in it"):
        score_files(tmp_path, tmp_path / "estimate.tum")


def test_a_relations_file_is_enough(tmp_path):
    write_tum(tmp_path / "estimate.tum", noisy(TRUTH, 2, 0.01))
    write_map(tmp_path / "map.yaml", room())
    stamps = TRUTH.stamps.tolist()
    rows = [f"{stamps[i]} {stamps[i + 1]} 0 0 0 0 0 0\n" for i in range(0, 300, 3)]
    (tmp_path / "x.relations").write_text("".join(rows))
    metrics = score_files(
        tmp_path, tmp_path / "estimate.tum", tmp_path / "map.yaml", relations=tmp_path / "x.relations"
    )
    assert metrics["relations"]["pairs"] == 100
    assert metrics["relations"]["loops"] is None


def test_relations_are_scored_on_the_dense_estimate():
    relations = Relations(
        TRUTH.stamps[1:200:2], TRUTH.stamps[101:300:2], between(TRUTH.poses[1:200:2], TRUTH.poses[101:300:2])
    )
    reference = Reference(relations=relations)
    metrics = score(TRUTH[::2], reference=reference, dense=TRUTH)
    assert (metrics["relations"]["pairs"], metrics["relations"]["unmatched"]) == (100, 0)
    assert metrics["outcome"] == "ok"
    with pytest.raises(RelationsError, match="none of the 100 relations"):
        score(TRUTH[::2], reference=reference)
