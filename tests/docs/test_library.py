# SPDX-License-Identifier: MIT
"""The code of docs/library.md runs as it stands, and its results are those of the robot that it was fed."""

import re
from pathlib import Path

import numpy as np
import pytest

from eval.files.map_server import read_map
from eval.files.tum import read_tum
from slam import se2
from tests.slam.rooms import drive, scan_at

PAGE = (Path(__file__).parents[2] / "docs" / "library.md").read_text(encoding="utf-8")
CODE = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
MOUNT = (0.1, 0.0, 0.0)


def my_robot(truth):
    """Stamps, odometry that is 3 % too long, and ranges of a lidar of 90 beams in a room."""
    rng = np.random.default_rng(0)
    odometry = np.zeros(3)
    for k, pose in enumerate(truth):
        if k > 0:
            odometry = se2.compose(odometry, se2.between(truth[k - 1], pose) * [1.03, 1.0, 1.0])
        scan = scan_at(pose, beams=90, mount=MOUNT, noise=0.01, rng=rng)
        yield 0.1 * k, odometry, np.interp(np.linspace(-np.pi, np.pi, 90, endpoint=False), scan.angles, scan.ranges)


def test_the_code_of_the_page_maps_a_room(tmp_path, monkeypatch, capsys):
    truth = drive(24, distance=0.15, turn=0.2)
    monkeypatch.chdir(tmp_path)
    names = {"my_robot": lambda: my_robot(truth)}
    for code in CODE:
        exec(compile(code, "docs/library.md", "exec"), names)
    assert re.match(r"<GMapping: 30 particles, \d+ updates, at \(.*\)> <StepReport: ", capsys.readouterr().out)
    for name in ("filter", "refined"):
        path = read_tum(f"{name}.tum")
        assert len(path) == 25
        assert np.hypot(*(path.poses - truth)[:, :2].T).max() < 0.1
        assert read_map(f"{name}.yaml").occupied.sum() > 100


@pytest.mark.parametrize("name", re.findall(r"`(?:mapper|step)\.(\w+)", PAGE))
def test_what_the_page_names_is_there(name):
    from slam.gmapping import GMapping
    from slam.step.step_report import StepReport

    assert hasattr(GMapping, name) or name in StepReport.__dataclass_fields__
