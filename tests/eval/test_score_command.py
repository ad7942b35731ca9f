# SPDX-License-Identifier: MIT
"""`testbed score` on every kind of bad input: one clear line, or a stated warning, never a silently good score."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from eval.files.map_server import read_map, write_map
from eval.files.tum import read_tum, write_tum
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from slam.se2 import compose
from tests.eval.helpers import moved
from tests.eval.synthetic_run import write_run
from tests.shell import call


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    return write_run(tmp_path_factory.mktemp("runs") / "good")


def score(*arguments: object) -> int:
    return call("score", *arguments)


def scored(capsys) -> dict:
    return json.loads(capsys.readouterr().out)


Change = Callable[[Trajectory], Trajectory]
shuffled = np.random.default_rng(0).permutation


def changed(stamps: Callable = lambda s: s, poses: Callable = lambda p: p) -> Change:
    return lambda t: Trajectory(stamps(t.stamps), poses(t.poses))


def in_degrees(poses):
    return np.column_stack([poses[:, :2], np.degrees(poses[:, 2])])


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (changed(lambda s: s + 1e6), "no pose of the estimate"),
        (changed(lambda s: s * 60.0), "no pose of the estimate"),
        (changed(lambda s: 1000.0 + 1000.0 * (s - 1000.0)), "are both in seconds"),
    ],
)
def test_times_that_do_not_meet_are_an_error(run, tmp_path, capsys, change, expected):
    write_tum(tmp_path / "t.tum", change(read_tum(run / "estimate.tum")))
    assert score(run, "--trajectory", tmp_path / "t.tum") == 2
    captured = capsys.readouterr()
    assert expected in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("{t} 0 0 0 0 0 0.9 0.9", "unit quaternion"),
        ("{t} 0 0 0 0.3 0 0 0.954", "in the plane"),
        ("{t} 0 0 0 0 0 1", "expected 8 numbers"),
    ],
)
def test_a_bad_line_is_named(run, tmp_path, capsys, line, expected):
    lines = (run / "estimate.tum").read_text().splitlines()
    lines[6] = line.format(t=lines[6].split()[0])
    (tmp_path / "t.tum").write_text("\n".join(lines))
    assert score(run, "--trajectory", tmp_path / "t.tum") == 2
    error = capsys.readouterr().err
    assert "t.tum:7: " in error
    assert expected in error


@pytest.mark.parametrize(
    ("change", "outcome", "note"),
    [
        (lambda t: t[shuffled(len(t))], "ok", "put in the order of time"),
        (lambda t: Trajectory(np.r_[t.stamps[0], t.stamps], np.r_[t.poses[:1], t.poses]), "ok", "1 repeated stamps"),
        (lambda t: t[: len(t) // 2], "lost", "spans only 50% of the true path"),
        (changed(poses=lambda p: p * [100.0, 100.0, 1.0]), "lost", "positions in metres?"),
        (changed(poses=lambda p: p * [1.0, -1.0, -1.0]), "lost", "only when mirrored"),
        (changed(poses=in_degrees), "lost", "are they in radians"),
        (changed(poses=lambda p: p * [1.0, 1.0, -1.0]), "lost", "counted clockwise"),
    ],
)
def test_doubtful_trajectories_are_scored_with_a_warning(run, tmp_path, capsys, change, outcome, note):
    write_tum(tmp_path / "t.tum", change(read_tum(run / "estimate.tum")))
    assert score(run, "--trajectory", tmp_path / "t.tum", "--out", tmp_path) == 0
    assert note in capsys.readouterr().err  # seen on the terminal, too
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["outcome"] == outcome
    assert any(note in sentence for sentence in metrics["notes"])


def test_one_pose_has_no_error_and_breaks_every_limit_on_it(run, tmp_path, capsys):
    write_tum(tmp_path / "t.tum", read_tum(run / "estimate.tum")[:1])
    assert score(run, "--trajectory", tmp_path / "t.tum", "--fail-if", "trajectory.ate_rmse_m > 0.05") == 1
    captured = capsys.readouterr()
    assert "could not be measured" in captured.err
    metrics = json.loads(captured.out)
    assert metrics["outcome"] == "unjudged"
    assert metrics["trajectory"]["ate_rmse_m"] is None


# --- maps


def coarser(grid: OccupancyGrid) -> OccupancyGrid:
    rows, cols = (2 * (side // 2) for side in grid.probability.shape)
    quarters = grid.probability[:rows, :cols].reshape(rows // 2, 2, cols // 2, 2)
    return OccupancyGrid(
        probability=np.fmax.reduce(np.fmax.reduce(quarters, axis=3), axis=1), resolution=0.1, origin=grid.origin
    )


def blank(value: float, side: int = 40) -> OccupancyGrid:
    return OccupancyGrid(probability=np.full((side, side), value, np.float32), resolution=0.05, origin=(0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("change", "note", "best_iou"),
    [
        (coarser, "cells of 0.1 m were drawn on the truth's of 0.05 m", None),
        (lambda g: moved(g, (500.0, 0.0, 0.0)), "map and trajectory may be in different frames", 0.5),
        (lambda g: moved(g, (0.0, 0.0, 1.0)), "origin is turned by 57.3 degrees", 0.5),
        (lambda g: OccupancyGrid(probability=g.probability, resolution=5.0, origin=g.origin), "in metres?", None),
        (lambda g: blank(np.nan), "not one known cell", None),
        (lambda g: blank(1.0, side=1), "", None),
        (lambda g: blank(0.0), "", None),
    ],
)
def test_doubtful_maps_are_scored_with_a_warning(run, tmp_path, capsys, change, note, best_iou):
    write_map(tmp_path / "m.yaml", change(read_map(run / "map.yaml")))
    assert score(run, "--trajectory", run / "estimate.tum", "--map", tmp_path / "m.yaml") == 0
    metrics = scored(capsys)
    assert not note or any(note in sentence for sentence in metrics["notes"])
    good = json.loads((run / "metrics.json").read_text())["map"]["iou"]
    assert metrics["map"]["iou"] < 0.7 * good
    if best_iou is not None:
        assert metrics["map"]["best_rigid"]["iou"] > best_iou * good


def test_the_score_does_not_depend_on_the_frame(run, tmp_path, capsys):
    T = (5.0, -3.0, 2.0)
    estimate = read_tum(run / "estimate.tum")
    write_tum(tmp_path / "t.tum", Trajectory(estimate.stamps, compose(T, estimate.poses)))
    write_map(tmp_path / "m.yaml", moved(read_map(run / "map.yaml"), T))
    assert score(run, "--trajectory", tmp_path / "t.tum", "--map", tmp_path / "m.yaml") == 0
    elsewhere = scored(capsys)
    assert score(run, "--trajectory", run / "estimate.tum", "--map", run / "map.yaml") == 0
    home = scored(capsys)
    assert elsewhere["outcome"] == home["outcome"] == "ok"
    for key in ("wall_distance_m", "iou", "log_loss"):
        assert elsewhere["map"][key] == pytest.approx(home["map"][key], rel=0.03), key


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("{{{{", "expected a map_server .yaml file"),
        ("image: gone.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n", "image: gone.pgm does not exist"),
        ("image: gone.pgm\nresolution: -1\norigin: [0, 0, 0]\n", "resolution: expected metres per pixel above 0"),
        ("image: gone.pgm\nresolution: 0.05\norigin: [0, 0, 90]\n", "looks like degrees"),
    ],
)
def test_a_map_that_is_none_is_named(run, tmp_path, capsys, content, expected):
    (tmp_path / "m.yaml").write_text(content)
    assert score(run, "--trajectory", run / "estimate.tum", "--map", tmp_path / "m.yaml") == 2
    assert expected in capsys.readouterr().err
