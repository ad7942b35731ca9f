# SPDX-License-Identifier: MIT
"""examples/my_slam.py and the smallest system of docs/systems.md do what the page says."""

import json
import re
from pathlib import Path

import pytest

from testbed.systems.check import check_system
from testbed.systems.entrant import PythonSystem
from testbed.systems.finding import BUILT_IN, BUILT_IN_PROGRAMS
from tests.shell import call

pytestmark = pytest.mark.usefixtures("without_pictures")
ROOT = Path(__file__).parents[3]
EXAMPLE = f"{ROOT / 'examples' / 'my_slam.py'}:MySlam"
PAGE = (ROOT / "docs" / "systems.md").read_text(encoding="utf-8")


def test_the_example_passes_the_check():
    assert [finding for finding in check_system(PythonSystem(EXAMPLE)) if finding.level != "ok"] == []


def test_the_example_beats_the_wheels_and_draws_a_map(tmp_path):
    drive = ("run", "office", "--backend", "fast", "--duration", "40", "--out", tmp_path / "out")
    assert call(*drive, "--system", f"{EXAMPLE},odometry") == 0
    mine, wheels = (json.loads((tmp_path / "out" / n / "metrics.json").read_text()) for n in ("MySlam", "odometry"))
    assert mine["trajectory"]["ate_rmse_m"] < 0.5 * wheels["trajectory"]["ate_rmse_m"]
    assert mine["map"]["f1_1_cells"] > 0.5
    assert mine["notes"] == []


def test_the_smallest_system_of_the_page_passes_the_check(tmp_path):
    (source,) = [code for code in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "class Wheels" in code]
    (tmp_path / "wheels.py").write_text(source)
    found = check_system(PythonSystem(f"{tmp_path / 'wheels.py'}:Wheels"))
    assert [finding for finding in found if finding.level != "ok"] == []


def test_the_page_names_all_systems_of_the_package():
    table = PAGE[PAGE.index("| name | what it is |") :].split("\n\n")[0]
    assert set(re.findall(r"^\| `([\w-]+)`", table, re.MULTILINE)) == {*BUILT_IN, *BUILT_IN_PROGRAMS}
