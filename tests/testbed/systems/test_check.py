# SPDX-License-Identifier: MIT
"""`testbed systems check`: each thing that it tries finds a system that breaks it, and lets the others pass."""

from itertools import pairwise

import pytest

from testbed.systems.check import BAD_INPUT, check_system, drive
from testbed.systems.entrant import PythonSystem
from testbed.systems.errors import SystemFailedError
from tests.shell import call

HEAD = """
import math
import random
import numpy as np
from slam.occupancy import OccupancyGrid

class Base:
    name, version = "mine", "1"
    def start(self, lidars, seed): self.lidars, self.seen = lidars, 0
    def process(self, frame): return frame.odometry
    def finish(self): return None, None
"""
BROKEN = {
    "random": ("def process(self, frame): return frame.odometry + 1e-9 * random.random()", "error", "same seed, other"),
    "global": (
        "def process(self, frame): return frame.odometry + np.random.normal(size=3)",
        "error",
        "same seed, other",
    ),
    "degrees": ("def process(self, frame): return frame.odometry * (100, 100, 57.3)", "warning", "is it T_map_robot"),
    "nan": ("def process(self, frame): return (math.nan, 0, 0)", "error", "expected a pose"),
    "brief": ("def process(self, frame): return frame.odometry if frame.stamp < 5 else None", "warning", "90 %"),
    "elsewhere": (
        "def finish(self): return None, OccupancyGrid(probability=np.full((9, 9), 0.1, np.float32), resolution=0.05, "
        "origin=(50.0, 0.0, 0.0))",
        "warning",
        "known part of the map",
    ),
    "hits": (
        "def process(self, frame):\n        assert frame.scan is None or frame.scan.hit.any()\n"
        "        return frame.odometry",
        "warning",
        "inf",
    ),
    "beams": (
        "def process(self, frame):\n        assert frame.scan is None or len(frame.scan.angles) == "
        "len(self.lidars[0].angles)\n        return frame.odometry",
        "warning",
        "other numbers of beams",
    ),
    "settings": ("settings = {'gain': 3}", "error", "expected a dataclass"),
}


def findings(tmp_path, body):
    (tmp_path / "s.py").write_text(f"{HEAD}\nclass Mine(Base):\n    {body}\n")
    return list(check_system(PythonSystem(f"{tmp_path / 's.py'}:Mine")))


@pytest.mark.parametrize("name", BROKEN)
def test_a_system_that_breaks_one_thing_is_found_out(tmp_path, name):
    body, level, words = BROKEN[name]
    found = [finding for finding in findings(tmp_path, body) if finding.level != "ok"]
    assert any(finding.level == level and words in finding.text for finding in found), found


def test_the_odometry_passes_everything(tmp_path):
    found = findings(tmp_path, "pass")
    assert {finding.level for finding in found} == {"ok"}
    assert set(BAD_INPUT) <= {finding.text for finding in found}


@pytest.mark.parametrize("name", ["odometry", "scan-matching"])
def test_own_systems_pass(name):
    assert [f.text for f in check_system(PythonSystem(name)) if f.level != "ok"] == []


def test_the_drive_and_its_bad_input_are_what_they_say():
    frames = drive()
    scans = [frame.scan for frame in frames if frame.scan is not None]
    assert len(scans) > 100
    changed = {name: change(frames) for name, change in BAD_INPUT.items()}
    stamps = [frame.stamp for frame in changed["stamps that repeat and step back"]]
    assert any(b == a for a, b in pairwise(stamps))
    assert any(b < a for a, b in pairwise(stamps))
    beams = {len(f.scan.angles) for f in changed["scans with other numbers of beams, one with none"] if f.scan}
    assert beams == {0, len(scans[0].angles) - 1, len(scans[0].angles)}
    assert {f.lidar for f in changed["two lidars, one looking backward"] if f.scan} == {frames[0].lidar, "second"}
    assert all(f.scan is not None for f in changed["no frames between the scans, no twist"])


def test_the_command_exits_with_1_on_errors_only(tmp_path, capsys):
    (tmp_path / "s.py").write_text(f"{HEAD}\nclass Bad(Base):\n    def process(self, frame): return 'here'\n")
    assert call("systems", "check", f"{tmp_path / 's.py'}:Base") == 0
    assert "0 errors, 0 warnings" in capsys.readouterr().out
    assert call("systems", "check", f"{tmp_path / 's.py'}:Bad") == 1
    assert "1 errors" in capsys.readouterr().out
    assert call("systems", "check", "nosuch") == 2


def test_a_failure_names_the_system(tmp_path):
    (tmp_path / "s.py").write_text(f"{HEAD}\nclass Bad(Base):\n    def process(self, frame): return 'here'\n")
    with pytest.raises(SystemFailedError, match=r"^Bad: "):
        PythonSystem(f"{tmp_path / 's.py'}:Bad").run(drive()[:50], seed=0)
