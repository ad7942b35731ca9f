# SPDX-License-Identifier: MIT
"""The whole chain as a user starts it: simulator or log, filter, measures, report, recording."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from eval.files.tum import read_tum
from eval.trajectory.association import associate
from eval.trajectory.errors import absolute_error
from eval.trajectory.trajectory import Trajectory
from testbed.run.run_directory import RUN_FILES
from tests.shell import TESTBED, call

DATASETS = Path(os.environ.get("TESTBED_DATASETS", Path(__file__).parents[3] / "shared" / "datasets"))


def testbed(folder: Path, *arguments: str | Path) -> dict:
    """Run `testbed … --out folder/run` in a process of its own; returns its metrics."""
    command = [*TESTBED, *map(str, arguments)]
    done = subprocess.run([*command, "--out", "run"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == f"report: {folder / 'run' / 'report.html'}"
    return json.loads((folder / "run" / "metrics.json").read_text())


testbed.__test__ = False  # not a test, in spite of its name


@pytest.mark.usefixtures("without_pictures")
def test_a_short_drive_is_mapped_scored_and_reported(tmp_path):
    metrics = testbed(tmp_path, "run", "loop", "--duration", "20", "--threads", "1")
    assert {path.name for path in (tmp_path / "run").iterdir()} == set(RUN_FILES) - {
        "program.log"
    }  # of --system-command
    assert metrics["outcome"] == "ok"
    assert metrics["scans"] == 200
    odometry, filtered, final = (
        part["ate_rmse_m"]
        for part in (metrics["trajectory"]["odometry"], metrics["trajectory_filter"], metrics["trajectory"])
    )
    # 0.054, 0.013, 0.0032 m. Plain motion model: 0.068 m in the filter. No final pass: 0.013 m at the end
    assert filtered < odometry / 2.0
    assert final < filtered / 2.0
    assert metrics["map"]["iou_1_cells"] > 0.93  # 0.97; 0.87 without the final pass
    again = tmp_path / "again"  # in this process, to save a start and the pictures
    assert call("run", "--config", tmp_path / "run" / "config.toml", "--threads", "2", "--out", again) == 0
    assert json.loads((again / "metrics.json").read_text())["result_hash"] == metrics["result_hash"]


@pytest.mark.slow
@pytest.mark.parametrize(("world", "seed"), [("office", "0"), ("office", "1"), ("loop", "0")])
def test_a_whole_tour_closes_its_loops(tmp_path, world, seed):
    metrics = testbed(tmp_path, "run", world, "--seed", seed)
    assert metrics["outcome"] == "ok"
    assert metrics["trajectory"]["ate_rmse_m"] < 0.015
    assert metrics["trajectory"]["heading_rmse_deg"] < 0.2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("log", "relations", "metres", "degrees"),
    [  # a tenth above the worst of 5 seeds, 0.0149 m and 0.37 deg; and what is promised, of which 0.0314 m is reached
        ("intel/intel-merged.clf.gz", "intel/intel-resolved.relations", 0.0165, 0.41),
        ("fr079/fr079-merged.clf.gz", "fr079/fr079.relations", 0.034, 0.48),
    ],
)
def test_recorded_logs_are_mapped_from_start_to_end(tmp_path, log, relations, metres, degrees):
    if not (DATASETS / log).exists():
        pytest.skip(f"{DATASETS / log} is absent: set TESTBED_DATASETS")
    metrics = testbed(tmp_path, "slam", DATASETS / log, "--relations", DATASETS / relations)
    assert metrics["relations"]["trans_mean_m"] < metres
    assert metrics["relations"]["rot_mean_deg"] < degrees


@pytest.mark.slow
def test_loops_of_a_sparse_log_are_closed(tmp_path):
    """ACES has no truth; the published gMapping run closed its four corridor loops, and so must we.

    Distances to its poses with seeds 0 to 4: 0.08 m; above 0.5 m a loop is open (1 of 20 seeds, 0.53 m). C++ gMapping
    with 15 particles: 0.89 m.
    """
    if not (DATASETS / "aces").exists():
        pytest.skip(f"{DATASETS / 'aces'} is absent: set TESTBED_DATASETS")
    reference = np.loadtxt(DATASETS / "aces" / "ref_gmapping_440.txt")
    errors = []
    for seed in range(5):
        folder = tmp_path / str(seed)
        folder.mkdir()
        testbed(folder, "slam", DATASETS / "aces" / "aces-merged.clf.gz", "--seed", str(seed))
        matched = associate(read_tum(folder / "run" / "estimate.tum"), Trajectory(reference[:, 0], reference[:, 1:]))
        assert len(matched.rows) == len(reference)
        errors.append(absolute_error(matched, "se2").translation.rmse)
    assert np.median(errors) < 0.1
    assert max(errors) < 0.5
