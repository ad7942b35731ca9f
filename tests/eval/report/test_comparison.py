# SPDX-License-Identifier: MIT
"""Several runs side by side: the better figure is marked, differing settings are found, failures are counted."""

import json
import re

import numpy as np
import pytest

from eval.files.run_reader import RunFilesError
from eval.files.tum import read_tum, write_tum
from eval.report.comparison import write_comparison
from eval.trajectory.trajectory import Trajectory
from tests.eval.synthetic_run import write_run

pytestmark = pytest.mark.usefixtures("without_pictures")  # which `test_comparison_plots.py` looks at


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    write_run(folder / "good")
    write_run(folder / "broken", broken=True, seed=3)
    write_run(folder / "log", truth=False)
    return folder


def cells(text: str, label: str) -> list[str]:
    row = re.search(rf"<tr><td>{re.escape(label)}</td>(.*?)</tr>", text, re.DOTALL)[1]
    return re.findall(r"<td.*?</td>", row)


def test_the_better_run_is_marked_and_what_is_unknown_is_a_dash(folder):
    text = write_comparison([folder / "good", folder / "broken", folder / "log"], folder / "c.html").read_text()
    good, broken, log = cells(text, "trajectory error, rmse [cm]")
    assert 'class="best"' in good
    assert 'class="best"' not in broken
    assert log == "<td>–</td>"
    assert [">good<" in text, ">broken<" in text, ">log<" in text] == [True] * 3
    assert "1 of 2 judged runs failed" in text
    # The same for all three, so no run is the best.
    assert not any("best" in cell for cell in cells(text, "memory [MB]"))


def test_a_run_that_failed_is_never_the_best_and_says_why(folder, tmp_path):
    """A path that ends early has small errors."""
    short = write_run(tmp_path / "short")
    metrics = json.loads((short / "metrics.json").read_text())
    metrics["trajectory"]["ate_rmse_m"] = 1e-4
    (short / "metrics.json").write_text(json.dumps(metrics | {"outcome": "lost", "outcome_reason": "spans 17%"}))
    text = write_comparison([folder / "good", short], tmp_path / "c.html").read_text()
    good, lost = cells(text, "trajectory error, rmse [cm]")
    assert 'class="best"' in good
    assert 'class="best"' not in lost
    assert "spans 17%" in cells(text, "why it failed")[1]


def test_only_settings_that_differ_are_listed(folder):
    text = write_comparison([folder / "good", folder / "broken"], folder / "c.html").read_text()
    assert [re.sub("<.*?>", "", cell) for cell in cells(text, "seed")] == ["0", "3"]
    assert "filter.particles" not in text
    same = write_comparison([folder / "good", folder / "log"], folder / "c.html").read_text()
    assert "All settings that the runs share are the same." in same


def test_across_places_no_figure_is_the_best_and_a_run_without_settings_differs_in_none(folder, tmp_path):
    other = write_run(tmp_path / "other", broken=True)
    config = (other / "config.toml").read_text()
    (other / "config.toml").write_text(config.replace('world = "ring"', 'world = "/far/away/maze.toml"'))
    truth = read_tum(other / "truth.tum")
    write_tum(other / "truth.tum", Trajectory(truth.stamps, truth.poses + np.array([1.0, 0.0, 0.0])))
    failed = tmp_path / "failed"
    failed.mkdir()
    (failed / "metrics.json").write_text('{"outcome": "failed", "reason": "no space left on the disk"}')
    text = write_comparison([folder / "good", other, failed], tmp_path / "c.html").read_text()
    assert [re.sub("<.*?>", "", cell) for cell in cells(text, "world or log")] == ["ring", "maze.toml", "–"]
    assert 'class="best"' not in text
    assert "different places" in text
    assert "All settings that the runs share are the same." in text
    assert "2 of 3 judged runs failed" in text


def test_runs_of_one_name_are_told_apart_by_their_folders(folder, tmp_path):
    other = write_run(tmp_path / "elsewhere" / "good")
    text = write_comparison([folder / "good", other], tmp_path / "c.html").read_text()
    assert "elsewhere/good" in text
    assert f"{folder.name}/good" in text


def test_one_run_or_none_is_refused(folder, tmp_path):
    with pytest.raises(ValueError, match="two or more"):
        write_comparison([folder / "good"], tmp_path / "c.html")
    with pytest.raises(RunFilesError, match=r"metrics\.json"):
        write_comparison([folder / "good", tmp_path], tmp_path / "c.html")
    assert not (tmp_path / "c.html").exists()
