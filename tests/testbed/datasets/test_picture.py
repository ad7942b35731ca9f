# SPDX-License-Identifier: MIT
"""The picture of one drive."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from testbed.datasets import open_dataset
from testbed.datasets.picture import draw_drive
from tests.shell import assert_refused, call


@pytest.fixture
def axes(monkeypatch):
    """The axes of all figures that are made."""
    found, add_subplot = [], Figure.add_subplot
    monkeypatch.setattr(Figure, "add_subplot", lambda *args: found.append(add_subplot(*args)) or found[-1])
    return found


def test_the_scan_lies_on_the_walls_of_the_map(made, tmp_path, axes):
    dataset = open_dataset(made / "office-0001")
    draw_drive(dataset, tmp_path / "one.png", "office", 2.0)
    lines = {line.get_label().split(" at ")[0]: line.get_xydata() for line in axes[0].lines}
    grid = dataset.truth_map
    walls = np.array(grid.origin[:2]) + grid.resolution * (np.argwhere(grid.probability > 0.5)[:, ::-1] + 0.5)
    apart = [np.hypot(*(walls - hit).T).min() for hit in lines["scan"]]
    assert np.median(apart) < 0.05
    assert np.array_equal(lines["true path"], dataset.truth[:, :2])
    assert np.allclose(lines["odometry, from the true start"][0], dataset.truth[0, :2])


def test_the_command_writes_a_picture(made, tmp_path, capsys):
    assert call("view", made / "office-0001", "--save", tmp_path / "one.png") == 0
    assert (tmp_path / "one.png").read_bytes().startswith(b"\x89PNG")
    assert_refused(capsys, "exists", "view", made / "office-0001", "--save", tmp_path / "one.png")
    two = (made / "office-0001", made / "office-0002")
    assert_refused(capsys, "one run, comparison, dataset or log", "view", *two, "--save", tmp_path / "two.png")
    assert not (tmp_path / "two.png").exists()
