# SPDX-License-Identifier: MIT
"""The code of docs/library.md runs as it stands, and makes of a drive what `testbed slam` makes of it."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eval.files.map_server import read_map
from eval.files.tum import read_tum
from slam import FilterConfig
from testbed.estimation.estimation import Estimation
from testbed.simulation import SimulationConfig, simulate
from worlds import load

PAGE = (Path(__file__).parents[2] / "docs" / "library.md").read_text(encoding="utf-8")
CODE = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def frames():
    """Frames with a scan of the default robot, whose lidar is that of the page."""
    with simulate(load("office"), SimulationConfig(backend="fast", duration=8.0)) as simulation:
        return [frame for frame in simulation if frame.scan is not None]


def test_the_code_of_the_page_makes_what_the_command_makes(frames, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = {"my_robot": lambda: ((f.stamp, f.odometry, f.twist, f.scan.ranges) for f in frames)}
    for code in CODE:
        exec(compile(code, "docs/library.md", "exec"), names)
    said = capsys.readouterr().out
    assert re.match(rf"<Recording: {len(frames)} scans, <GMapping: 30 particles, .*>> <StepReport: ", said)
    estimation = Estimation(FilterConfig(particles=30), 0)
    for frame, scan in zip(frames, names["recording"].scans, strict=True):
        np.testing.assert_allclose(scan.angles, frame.scan.angles, atol=1e-9)
        np.testing.assert_allclose(scan.time_offsets, frame.scan.time_offsets, atol=1e-9)
        np.testing.assert_allclose(scan.mount, frame.scan.mount)
        estimation.process(replace(frame, scan=scan))
    filtered = estimation.filtered()
    for name, expected in (("filter", filtered), ("refined", estimation.refined(filtered))):
        np.testing.assert_allclose(read_tum(f"{name}.tum").poses, expected.dense.poses, atol=1e-6)
        assert abs(int(read_map(f"{name}.yaml").occupied.sum()) - int(expected.map.occupied.sum())) <= 2


@pytest.mark.parametrize("name", re.findall(r"`(?:mapper|step|recording)\.(\w+)", PAGE))
def test_what_the_page_names_is_there(name):
    from slam import GMapping, Recording
    from slam.step.step_report import StepReport

    assert any(hasattr(cls, name) for cls in (GMapping, Recording)) or name in StepReport.__dataclass_fields__
