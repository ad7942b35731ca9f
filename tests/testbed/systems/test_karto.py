# SPDX-License-Identifier: MIT
"""Karto by yag-slam: its figures on recorded logs with default settings, and a check of the adapter."""

import os
from pathlib import Path

import numpy as np
import pytest

from eval.trajectory.association import associate
from eval.trajectory.errors import absolute_error
from eval.trajectory.trajectory import Trajectory
from slam import se2
from testbed.formats import open_log
from testbed.systems.check import check_system
from testbed.systems.entrant import PythonSystem
from testbed.systems.finding import BUILT_IN
from tests.testbed.systems.room import frames

pytestmark = pytest.mark.skipif(
    not BUILT_IN["karto"].is_installed, reason="yag-slam is not installed: pip install 'slam-testbed[karto]'"
)
DATASETS = Path(os.environ.get("TESTBED_DATASETS", Path(__file__).parents[4] / "shared" / "datasets"))
PUBLISHED = {"seattle": 2.55, "edmonton": 0.94, "acapulco": 2.35}
"""Distance to the reference on logs, root mean square after alignment, as the datasets' own page states it [m]."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_karto_scores_on_logs_what_is_published(name):
    logs = sorted((DATASETS / name).glob("*-merged.clf.gz"))
    if not logs:
        pytest.skip(f"no log {name} in {DATASETS}")
    reference = np.loadtxt(next((DATASETS / name).glob("ref_gmapping_*.txt")))
    estimated, _ = PythonSystem("karto").run(open_log(logs[0]).frames, seed=0)
    matched = associate(estimated.dense[estimated.at_scans], Trajectory(reference[:, 0], reference[:, 1:4]))
    assert absolute_error(matched, "se2").translation.rmse == pytest.approx(PUBLISHED[name], rel=0.1)


def test_karto_follows_a_circle_and_draws_its_walls():
    drive = frames(scans=60, between=1)
    estimated, _ = PythonSystem("karto").run(drive, seed=0)
    truth = np.array([frame.truth for frame in drive])[estimated.frames]
    error = se2.between(se2.between(truth[0], truth), se2.between(estimated.dense.poses[0], estimated.dense.poses))
    assert np.abs(error[:, :2]).max() < 0.1
    grid = estimated.grid
    rows, cols = np.nonzero(grid.occupied)
    corner = se2.transform_points(grid.origin, np.column_stack([cols + 0.5, rows + 0.5]) * grid.resolution)
    walls = se2.transform_points(truth[0], se2.transform_points(se2.inverse(estimated.dense.poses[0]), corner))
    assert len(walls) > 100
    assert np.median(np.abs(np.abs(walls).max(axis=1) - 4.0)) < 0.1  # on the walls of the room


def test_karto_breaks_no_rule_of_the_protocol():
    assert [finding.text for finding in check_system(PythonSystem("karto")) if finding.level == "error"] == []
