# SPDX-License-Identifier: MIT
"""KISS-ICP on flat clouds: it follows a recorded drive without wheels, and keeps the protocol."""

import json

import numpy as np
import pytest

from slam import se2
from testbed.systems.check import check_system
from testbed.systems.entrant import PythonSystem
from testbed.systems.finding import BUILT_IN
from tests.shell import call
from tests.testbed.systems.room import frames

pytestmark = pytest.mark.skipif(
    not BUILT_IN["kiss-icp"].is_installed, reason="kiss-icp is not installed: pip install 'slam-testbed[kiss-icp]'"
)


def test_kiss_icp_follows_a_circle_without_wheels():
    drive = frames(scans=60, between=1)
    still = [type(f)(stamp=f.stamp, odometry=np.zeros(3), scan=f.scan, truth=f.truth) for f in drive]
    estimated, _ = PythonSystem("kiss-icp").run(still, seed=0)
    at = estimated.at_scans
    truth = np.array([drive[row].truth for row in estimated.frames[at]])
    error = se2.between(
        se2.between(truth[0], truth), se2.between(estimated.dense.poses[at[0]], estimated.dense.poses[at])
    )
    assert np.abs(error[:, :2]).max() < 0.15
    assert np.abs(truth[-1, :2] - truth[0, :2]).max() > 1.0


def test_kiss_icp_runs_from_the_command_line(tmp_path):
    assert (
        call("run", "office", "--backend", "fast", "--duration", "10", "--system", "kiss-icp", "--out", tmp_path) == 0
    )
    metrics = json.loads((tmp_path / "kiss-icp" / "metrics.json").read_text())
    assert metrics["system"]["name"] == "kiss-icp"
    assert metrics["system"]["version"].startswith("kiss-icp ")
    assert "map" not in metrics


def test_kiss_icp_breaks_no_rule_of_the_protocol():
    assert [finding.text for finding in check_system(PythonSystem("kiss-icp")) if finding.level == "error"] == []
