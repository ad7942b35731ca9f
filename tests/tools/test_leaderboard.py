# SPDX-License-Identifier: MIT
"""The leaderboard gives each system what it needs, and references the stamps of the scans."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eval.files.tum import read_tum
from testbed.formats import open_log
from testbed.sweep.spec.spec import parse_spec
from tests.shell import call
from tools.measure import leaderboard
from tools.measure.leaderboard import parts, places_table, source_of, world_runs, worlds_table
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
    systems = ["odometry", "mrpt-rbpf", "gmapping", "scan-matching"]
    found = {part.name: part.document for part in parts(tmp_path, systems, ["office"], [log], 5)}
    assert found["world-office"]["axes"]["system"] == ["odometry", "mrpt-rbpf"]
    assert found["world-office-own"]["axes"]["system"] == ["gmapping", "scan-matching"]
    assert {name: (found[name]["axes"]["system"], found[name]["seeds"]) for name in found if "logs" in name} == {
        "logs": (["odometry"], 1),
        "logs-drawn": (["mrpt-rbpf"], 5),
        "logs-own": (["scan-matching"], 1),
        "logs-drawn-own": (["gmapping"], 5),
    }
    for document in found.values():
        assert parse_spec(document, "test", tmp_path).names_systems
    assert [part.name for part in parts(tmp_path, ["odometry"], [], [log], 5)] == ["logs"]


def table_of(
    place: str,
    ran: list[list[bool]],
    errors: list[list[float]],
    failed: list[list[bool]],
    lines: tuple[str, ...] = ("odometry", "gmapping"),
    commit: str = "abc",
    wheels: float = 0.5,
) -> Any:
    """What the tables read of a sweep over one place: arrays (systems, seeds)."""
    shape = (1, len(ran), 1, len(ran[0]))

    def cube(name: str) -> np.ndarray:
        known = {"trajectory.ate_rmse_m": errors, "cpu_s": np.full(shape, 2.0), "scans": np.full(shape, 100.0)}
        known["trajectory.odometry.ate_rmse_m"] = np.full(shape, wheels)
        return np.reshape(np.asarray(known.get(name, np.full(shape, np.nan)), dtype=float), shape)

    return SimpleNamespace(
        places=(place,),
        lines=lines,
        commit=commit,
        ran=np.reshape(ran, shape),
        failed=np.reshape(failed, shape),
        conditions="robot create3",
        cube=cube,
    )


def test_totals_count_only_drives_that_all_systems_did() -> None:
    """The first system has done a drive more, the one that it failed; it must not count."""
    ran, errors = [[True, True], [True, False]], [[0.1, 9.0], [0.02, np.nan]]
    half = table_of("office", ran, errors, [[False, True], [False, False]])
    whole = table_of("loop", [[True] * 2] * 2, [[0.3, 0.3], [0.04, 0.04]], [[True, True], [False, False]])
    text = worlds_table([world_runs([half]), world_runs([whole])])
    rows = {line.split(" | ")[0].strip("| "): line.split(" | ") for line in text.splitlines() if line.startswith("|")}
    assert rows["odometry"][2] == "2 of 3 (21% to 94%)"
    assert rows["odometry"][3].startswith("30.0 ")
    assert rows["gmapping"][5].startswith("20.0 ")  # CPU time: 2 s for 100 scans
    assert rows["gmapping"][2] == "0 of 3 (0% to 56%)"
    assert "3 drives of 4 that were begun, which all systems did: office 1, loop 2" in text


def test_each_world_says_how_many_runs_a_figure_rests_on() -> None:
    ran, errors = [[True, True], [True, False]], [[0.1, 9.0], [0.02, np.nan]]
    text = places_table([world_runs([table_of("office", ran, errors, [[False, True], [False, False]])])])
    assert text.splitlines()[-1] == "| office | 455.0 cm (10.0 to 900.0), 1 of 2 failed | 2.0 cm |"
    unknown = table_of("lab", [[False, False]] * 2, [[np.nan] * 2] * 2, [[False] * 2] * 2)
    nothing = places_table([world_runs([unknown])])
    assert nothing.splitlines()[-1] == "| lab | not run | not run |"


def test_systems_of_this_package_are_joined_with_the_others_of_the_same_drives() -> None:
    """Ours were run with a seed less, and with another commit, which the page says."""
    others = table_of("office", [[True] * 3], [[0.5, 0.6, 0.7]], [[True] * 3], lines=("odometry",), commit="old")
    own = table_of("office", [[True] * 2], [[0.02, 0.04]], [[False] * 2], lines=("gmapping",), commit="new")
    joined = world_runs([others, own])
    assert joined.systems == ["gmapping", "odometry"]
    np.testing.assert_allclose(joined.error, [[0.02, 0.04, np.nan], [0.5, 0.6, 0.7]])
    text = worlds_table([joined])
    assert "2 drives of 3 that were begun, which all systems did: office 2" in text
    assert "Computed with new: gmapping; old: odometry." in text
    elsewhere = table_of("office", [[True] * 2], [[0.02, 0.04]], [[False] * 2], lines=("gmapping",), wheels=0.6)
    with pytest.raises(ValueError, match="office: the sweeps are of different drives"):
        world_runs([others, elsewhere])


def test_worlds_with_a_short_tour_come_first_and_those_with_a_long_one_get_one_seed(tmp_path: Path) -> None:
    found = parts(tmp_path, ["odometry"], ["campus", "maze", "office"], [], 5)
    assert [(part.name, part.document["seeds"]) for part in found] == [
        ("world-office", 5), ("world-maze", 5), ("world-campus", 1),
    ]  # fmt: skip


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
