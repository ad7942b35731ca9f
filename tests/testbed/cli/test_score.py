# SPDX-License-Identifier: MIT
"""`testbed score --out` explains a score as a run's report does."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from eval.files.tum import read_tum, write_tum
from eval.trajectory.trajectory import Trajectory
from slam.se2 import between, compose
from tests.eval.synthetic_run import write_run
from tests.shell import call


@pytest.mark.usefixtures("without_pictures")
def test_the_moment_and_a_report_are_written(tmp_path: Path) -> None:
    run, out = write_run(tmp_path / "run"), tmp_path / "scored"
    good = read_tum(run / "estimate.tum")
    poses = good.poses.copy()
    poses[400:] = compose(compose(poses[400], [0.0, 0.0, 1.0]), between(poses[400], poses[400:]))
    write_tum(tmp_path / "turned.tum", Trajectory(good.stamps, poses))
    assert call("score", run, "--trajectory", tmp_path / "turned.tum", "--map", run / "map.yaml", "--out", out) == 0
    finding = json.loads((out / "finding.json").read_text())
    assert finding["bad"]
    assert finding["stamp"] == pytest.approx(good.stamps[400], abs=0.5)
    assert "Where it went wrong" in (out / "report.html").read_text()
    assert json.loads((out / "metrics.json").read_text())["outcome"] != "ok"


@pytest.mark.parametrize("kind", ["rosbag2", "parquet", "rosbag1", "carmen"])
def test_the_lidar_of_a_dataset_is_known_in_every_format(
    tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ("simulate", "office", "--backend", "fast", "--duration", 2, "--lidar", "lds01", "--format", kind)
    assert call(*command, "--out", tmp_path / "data") == 0
    (dataset,) = (tmp_path / "data").iterdir()
    scored = ("--trajectory", dataset / "truth.tum", "--map", dataset / "truth_map.yaml")
    capsys.readouterr()
    assert call("score", dataset, *scored) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["map"]["observable_cells"] > 0
    assert "the lidar is unknown" not in said.err


def test_a_run_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = write_run(tmp_path / "run")
    before = (run / "metrics.json").read_text()
    assert call("score", run, "--trajectory", run / "estimate.tum", "--out", run) == 2
    assert "choose another --out" in capsys.readouterr().err
    assert (run / "metrics.json").read_text() == before
