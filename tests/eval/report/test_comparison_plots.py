# SPDX-License-Identifier: MIT
"""Runs of one recording are known by its content, and drawn over one map, however their directories came about."""

import base64
import json
import re

import numpy as np
import pytest

from eval.files.run_reader import read_run
from eval.files.tum import read_tum, write_tum
from eval.report.comparison import write_comparison
from eval.report.comparison_plots import (
    cost_plots,
    difference_plots,
    map_plots,
    part_around,
    path_plots,
    same_data,
    time_per_scan,
)
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from tests.eval.synthetic_run import write_run
from tests.shell import call


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    write_run(folder / "mine")
    write_run(folder / "noisier", seed=4)
    write_run(folder / "log", truth=False)
    return folder


@pytest.fixture(scope="module")
def scored(folder):
    """Another system's trajectory, scored as docs/systems.md says: its directory names no world."""
    theirs = read_tum(folder / "noisier" / "estimate.tum")
    write_tum(folder / "theirs.tum", theirs)
    assert call("score", folder / "mine", "--trajectory", folder / "theirs.tum", "--out", folder / "scored") == 0
    assert not (folder / "scored" / "config.toml").exists()
    return folder / "scored"


@pytest.mark.usefixtures("without_pictures")
def test_a_scored_trajectory_and_a_run_of_its_data_are_one_recording(folder, scored):
    assert same_data(read_run(scored), read_run(folder / "mine"))
    text = write_comparison([scored, folder / "mine"], folder / "c.html").read_text()
    assert "different places" not in text
    row = re.search(r"<tr><td>world or log</td>(.*?)</tr>", text)[1]
    assert re.findall(r"<td>(.*?)</td>", row) == ["ring", "ring"]
    assert 'class="best"' in text
    assert "Trajectories and cost" in text


def test_both_trajectories_are_drawn_over_the_true_map(folder, scored):
    runs = [("theirs", read_run(scored)), ("mine", read_run(folder / "mine"))]
    trajectories, error = path_plots(runs)
    assert "over the true map" in trajectories.caption
    for plot in (trajectories, error):
        drawn = svg(plot.source)
        assert "theirs" in drawn
        assert "mine" in drawn
    assert "truth" in svg(trajectories.source)


def test_errors_while_driving_are_drawn_where_they_are_others(tmp_path):
    runs = [(name, read_run(write_run(tmp_path / name, seed=seed))) for name, seed in (("a", 3), ("b", 4))]
    for _, run in runs:
        write_tum(run.path / "online.tum", run.estimate)
    assert [plot.title for plot in path_plots(runs)] == ["Trajectories", "Position error over time"]
    shaken = run.estimate.poses + np.random.default_rng(0).normal(scale=0.05, size=(len(run.estimate), 3))
    write_tum(run.path / "online.tum", Trajectory(run.estimate.stamps, shaken))
    *_, online = path_plots(runs)
    assert online.title == "Position error while driving"
    assert "b" in svg(online.source)


def test_the_part_of_a_map_around_the_paths_is_shown():
    grid = OccupancyGrid(probability=np.zeros((400, 600), np.float32), resolution=0.1, origin=(0.0, 0.0, 0.0))
    assert part_around(grid, np.zeros(3), [[[10.0, 10.0], [12.0, 11.0]]]).extent == pytest.approx((9, 13, 9, 12))
    assert part_around(grid, np.zeros(3), [[[10.0, 10.0], [30.0, 11.0]]]).extent == pytest.approx((7, 33, 7, 14))


def svg(source: str) -> str:
    return base64.b64decode(source.partition("base64,")[2]).decode()


def test_data_that_differ_are_no_one_recording(folder, tmp_path):
    mine, other = read_run(folder / "mine"), tmp_path / "other"
    write_run(other)
    truth = read_tum(other / "truth.tum")
    write_tum(other / "truth.tum", Trajectory(truth.stamps, truth.poses + np.array([0.01, 0.0, 0.0])))
    assert not same_data(mine, read_run(other))
    write_tum(other / "truth.tum", Trajectory(truth.stamps + 0.05, truth.poses))
    assert not same_data(mine, read_run(other))
    write_tum(other / "truth.tum", truth[::2])  # a dataset has the truth at another rate
    assert same_data(mine, read_run(other))


@pytest.mark.usefixtures("without_pictures")
def test_without_truth_the_odometry_tells(folder, tmp_path):
    write_run(tmp_path / "again", truth=False)
    write_run(tmp_path / "other", truth=False, seed=9)  # other wheels
    log = read_run(folder / "log")
    assert same_data(log, read_run(tmp_path / "again"))
    assert not same_data(log, read_run(tmp_path / "other"))
    (trajectories,) = path_plots([("log", log), ("again", read_run(tmp_path / "again"))])
    assert "over the map of log" in trajectories.caption


def test_maps_stand_in_the_frame_of_the_truth(folder):
    runs = [("mine", read_run(folder / "mine")), ("noisier", read_run(folder / "noisier"))]
    maps, differences = list(map_plots(runs)), list(difference_plots(runs))
    assert [plot.title for plot in maps] == ["truth", "mine", "noisier"]
    assert [plot.title for plot in differences] == ["mine", "noisier"]
    sizes = {png_size(plot.source) for plot in (*maps, *differences)}
    assert len(sizes) == 1  # one frame


def png_size(source: str) -> tuple[int, int]:
    header = base64.b64decode(source.partition("base64,")[2])[16:24]
    return int.from_bytes(header[:4], "big"), int.from_bytes(header[4:], "big")


@pytest.mark.usefixtures("without_pictures")
def test_cost_stands_against_accuracy(folder, tmp_path):
    for name, cost in (("fast", 2.0), ("slow", 50.0)):
        write_run(tmp_path / name)
        path = tmp_path / name / "metrics.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"system": {"ms_per_scan": cost, "memory_mb": cost}}))
    runs = [(name, read_run(tmp_path / name)) for name in ("fast", "slow")]
    assert [plot.title for plot in cost_plots(runs)] == ["Accuracy against time", "Accuracy against memory"]
    assert time_per_scan(runs[1][1]) == 50.0
    mine = read_run(folder / "mine")  # a run of this package's filter states no cost of its own
    assert time_per_scan(mine) == pytest.approx(1e3 * mine.metric("wall_s") / mine.metric("scans"))
    assert list(cost_plots(runs[:1])) == []


@pytest.mark.usefixtures("without_pictures")
def test_a_run_that_failed_takes_no_part(folder, tmp_path):
    failed = tmp_path / "failed"
    failed.mkdir()
    (failed / "metrics.json").write_text('{"outcome": "failed", "reason": "raised"}')
    text = write_comparison([folder / "mine", folder / "noisier", failed], tmp_path / "c.html").read_text()
    assert np.all([f">{name}<" in text for name in ("mine", "noisier", "failed")])
    assert "Trajectories and cost" in text
