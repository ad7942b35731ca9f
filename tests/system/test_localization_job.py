# SPDX-License-Identifier: MIT
"""`testbed slam LOG --map MAP.yaml` as a user starts it."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from eval.files.map_server import read_map
from eval.files.tum import read_tum
from tests.shell import TESTBED, assert_refused, call


def testbed(folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [*TESTBED, *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


testbed.__test__ = False  # not a test, in spite of its name


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("localization")
    assert call("simulate", "apartment", "--out", folder / "data", "--count", "1", "--duration", "12") == 0
    return folder


def metrics_of(run: Path) -> dict:
    return json.loads((run / "metrics.json").read_text())


@pytest.mark.usefixtures("without_pictures")
def test_a_robot_is_found_scored_in_the_frame_of_the_map_and_the_run_is_repeatable(folder):
    data = Path("data/apartment-0000")
    done = testbed(folder, "slam", data, "--map", data / "truth_map.yaml", "--out", "a", "--threads", "1")
    assert done.returncode == 0, done.stderr
    assert "found after driving" in done.stdout
    metrics = metrics_of(folder / "a")
    found = metrics["localization"]
    assert metrics["outcome"] == "ok"
    assert (found["start"], found["state"], found["losses"]) == ("unknown", "found", 0)
    assert found["error_median_m"] < 0.03
    assert "map" not in metrics  # nobody's result
    estimate, truth = read_tum(folder / "a" / "estimate.tum"), read_tum(folder / "a" / "truth.tum")
    assert np.median(np.hypot(*(estimate.poses - truth.poses)[:, :2].T)) == pytest.approx(found["error_median_m"])
    given, written = read_map(folder / data / "truth_map.yaml"), read_map(folder / "a" / "map.yaml")
    np.testing.assert_array_equal(given.occupied, written.occupied)
    assert not (folder / "a" / "filter.tum").exists()  # no final pass
    config = ("--config", folder / "a" / "config.toml")  # in this process, to save a start and the pictures
    assert call("slam", *config, folder / data, "--out", folder / "b", "--threads", "2") == 0
    assert metrics_of(folder / "b")["result_hash"] == metrics["result_hash"]


def test_a_given_start_may_be_negative_and_complaints_are_one_line(folder, capsys):
    data = folder / "data" / "apartment-0000"
    for start, words in (
        ("-30,2,90", "truth_map.yaml: start (-30, 2) m lies"),
        ("1,2", "truth_map.yaml: start '1,2': expected X,Y,DEG"),
    ):
        chosen = ("--map", data / "truth_map.yaml", "--start", start)
        assert_refused(capsys, words, "slam", data, *chosen, "--out", folder / "bad")
        assert not (folder / "bad").exists()
    words = "--start 1,2,3: needs a map, expected --map FILE.yaml as well"
    assert_refused(capsys, words, "slam", data, "--start", "1,2,3", "--out", folder / "bad")
