# SPDX-License-Identifier: MIT
"""The leaderboard gives each system what it needs, and references the stamps of the scans."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from eval.files.tum import read_tum
from testbed.formats import open_log
from testbed.sweep.spec.spec import parse_spec
from tests.shell import call
from tools.measure import leaderboard
from tools.measure.leaderboard import parts, source_of
from tools.measure.real_logs import CASES, Case


@pytest.fixture
def log(tmp_path: Path, monkeypatch) -> str:
    """A log of three scans with published poses whose stamps are rounded."""
    file = tmp_path / "robot.log"
    readings = " ".join(["2.5"] * 180)
    scans = [f"FLASER 180 {readings} {x} 0 0 {x} 0 0 {x}.123456 host {x}.123456" for x in (1, 2, 3)]
    file.write_text("\n".join(scans) + "\n")
    poses = tmp_path / "poses.txt"
    poses.write_text("1.12 1 0 0\n3.12 3 0 0\n")
    monkeypatch.setitem(CASES, "robot", Case(file, poses=poses))
    return "robot"


def test_published_poses_get_the_stamps_of_the_nearest_scans(log: str, tmp_path: Path) -> None:
    source = source_of(log, tmp_path)
    stamps = open_log(source["log"]).table.stamps
    np.testing.assert_allclose(read_tum(source["truth"]).stamps, stamps[[0, 2]], atol=1e-6)


def test_only_systems_that_draw_numbers_get_several_seeds_on_logs(log: str, tmp_path: Path) -> None:
    found = {part.name: part.document for part in parts(tmp_path, ["odometry", "gmapping"], ["office"], [log], 5)}
    assert found["worlds"]["axes"]["system"] == ["odometry", "gmapping"]
    assert (found["logs"]["axes"]["system"], found["logs"]["seeds"]) == (["odometry"], 1)
    assert (found["logs-drawn"]["axes"]["system"], found["logs-drawn"]["seeds"]) == (["gmapping"], 5)
    for document in found.values():
        assert parse_spec(document, "test", tmp_path).names_systems
    assert [part.name for part in parts(tmp_path, ["odometry"], [], [log], 5)] == ["logs"]


@pytest.mark.usefixtures("in_this_process", "without_pictures")
def test_tables_of_a_small_leaderboard_are_written(tmp_path: Path, monkeypatch) -> None:
    page = tmp_path / "leaderboard.md"
    page.write_text(Path(leaderboard.PAGE).read_text(encoding="utf-8"))
    monkeypatch.setattr(leaderboard, "PAGE", page)
    monkeypatch.setattr(leaderboard, "subprocess", SimpleNamespace(run=_here))
    whole = leaderboard.parts
    monkeypatch.setattr(leaderboard, "parts", lambda *given: [_short(part) for part in whole(*given)])
    arguments = [str(tmp_path / "out"), "--systems", "odometry", "--worlds", "office", "--logs", "none", "--seeds", "2"]
    monkeypatch.setattr("sys.argv", ["leaderboard", *arguments, "--workers", "1"])
    leaderboard.main()
    row = next(line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| odometry |"))
    assert "0 of 2 (0% to 66%)" in row
    assert "–" in row  # odometry has no map


def _here(command: list[str], check: bool) -> subprocess.CompletedProcess:
    """Run `testbed` in this process."""
    program, *words = command
    assert Path(program) == Path(sys.executable).with_name("testbed")
    return subprocess.CompletedProcess(command, call(*words))


def _short(part: leaderboard.Part) -> leaderboard.Part:
    part.document["settings"]["duration"] = 5.0
    return part
