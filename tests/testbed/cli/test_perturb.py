# SPDX-License-Identifier: MIT
"""`testbed perturb`: what it writes is read again, holds the truth, and can be made again to the last byte."""

from __future__ import annotations

import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest

from eval.files.tum import read_tum
from testbed.formats import open_log
from testbed.formats.write import write_log
from testbed.seeds import RunSeeds
from testbed.stress.table import perturb
from tests.shell import assert_refused, call
from tests.testbed.recordings import two_lidar_drive

OPTIONS = ("--drop-scans", "0.4", "--range-noise", "0.05", "--slip", "2", "--seed", "3")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    write_log(tmp_path / "log", two_lidar_drive(), "parquet")
    return tmp_path / "log"


def content(directory: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in directory.iterdir()}


def test_the_output_holds_the_perturbed_frames_and_their_truth(log: Path, tmp_path: Path) -> None:
    assert call("perturb", log, tmp_path / "out", *OPTIONS) == 0  # in the format of the log
    assert (tmp_path / "out" / "frames.parquet").is_file()
    chosen = {"drop-scans": 0.4, "range-noise": 0.05, "slip": 2.0}
    expected = perturb(open_log(log).frames, chosen, RunSeeds.from_seed(3).perturbation)
    written = open_log(tmp_path / "out").frames
    assert [f.scan is None for f in written] == [f.scan is None for f in expected]
    for got, put in zip(written, expected, strict=True):
        np.testing.assert_array_equal(got.odometry, put.odometry)
        np.testing.assert_array_equal(got.truth, put.truth)
        if put.scan is not None:
            np.testing.assert_array_equal(got.scan.ranges, put.scan.ranges)
    truth = read_tum(tmp_path / "out" / "truth.tum")
    np.testing.assert_allclose(truth.stamps, [f.stamp for f in expected if f.scan is not None])


@pytest.mark.parametrize("kind", ["rosbag2", "carmen"])
def test_the_command_in_the_config_makes_the_same_bytes(log: Path, tmp_path: Path, kind: str, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert call("perturb", log, "out", *OPTIONS, "--to", kind) == 0
    first = content(tmp_path / "out")
    made = tomllib.loads(first["config.toml"].decode())["perturbed"]
    assert made["values"] == {"range-noise": 0.05, "drop-scans": 0.4, "slip": 2.0}
    (tmp_path / "out").rename(tmp_path / "before")
    program, *words = shlex.split(made["command"])
    assert program == "testbed"
    assert call(*words) == 0
    assert content(tmp_path / "out") == first
    assert call("perturb", log, "other", *OPTIONS[:-1], 4, "--to", kind) == 0
    assert content(tmp_path / "other")["config.toml"] != first["config.toml"]


def test_bad_requests_are_refused_and_nothing_is_written(log: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert_refused(capsys, "nothing to change", "perturb", log, out)
    assert_refused(capsys, "drop-scans = 2: expected 0 to less than 1", "perturb", log, out, "--drop-scans", 2)
    assert_refused(capsys, "exists", "perturb", log, log, "--askew", 2)
    assert_refused(capsys, "seed must not be negative", "perturb", log, out, "--askew", 2, "--seed", -1)
    assert_refused(capsys, "no-such-log", "perturb", tmp_path / "no-such-log", out, "--askew", 2)
    assert not out.exists()
