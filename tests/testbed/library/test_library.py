# SPDX-License-Identifier: MIT
"""`testbed.library`: its results are those of the commands, and show themselves in a notebook."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import testbed.library as tb
from eval.trajectory.trajectory import Trajectory
from slam import se2
from testbed.cli.shared import sweep_options
from testbed.library.notebook import html_of
from testbed.systems.errors import SystemFailedError, SystemsError
from tests.cheaper import computed_here, undrawn
from tests.shell import call
from tests.testbed.sweep.room import room_file
from tests.testbed.systems.room import Wheels

PAGE = (Path(__file__).parents[3] / "docs" / "python.md").read_text(encoding="utf-8")
SETTINGS = {"lidar": "lds01"}


@pytest.fixture(scope="module")
def drive() -> tb.Drive:
    return tb.simulate("office", seed=3, duration=6, settings=SETTINGS)


def test_the_page_runs_as_it_stands(capsys) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    exec(compile(code, "docs/python.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines if line.startswith("<Result")] == [
        "MySlam", "odometry", "scan-matching", "MySlam",
    ]  # fmt: skip


def test_the_page_names_every_call() -> None:
    named = set(re.findall(r"^\| `(\w+)\(", PAGE, re.MULTILINE))
    assert named == {name for name in tb.__all__ if name[0].islower()}


def test_a_result_is_that_of_the_command(drive: tb.Drive, tmp_path: Path) -> None:
    command = ("run", "office", "--backend", "fast", "--duration", 6, "--lidar", "lds01", "--seed", 3)
    with undrawn():
        assert call(*command, "--system", "odometry,scan-matching", "--out", tmp_path / "out") == 0
    for name in ("odometry", "scan-matching"):
        expected = json.loads((tmp_path / "out" / name / "metrics.json").read_text())
        found = tb.run(name, drive, seed=3).metrics
        assert found["result_hash"] == expected["result_hash"]
        assert found["trajectory"]["ate_rmse_m"] == expected["trajectory"]["ate_rmse_m"]
        assert found.get("map", {}).get("f1_1_cells") == expected.get("map", {}).get("f1_1_cells")


def test_classes_and_instances_are_systems(drive: tb.Drive) -> None:
    expected = tb.run("odometry", drive).trajectory.poses
    for system in (Wheels, Wheels()):
        result = tb.run(system, drive)
        assert result.system == "Wheels"
        np.testing.assert_array_equal(result.trajectory.poses, expected)
    assert tb.check(Wheels).is_ok
    with pytest.raises(SystemsError, match="int: lacks name, version, start, process, finish"):
        tb.run(int, drive)

    class Broken(Wheels):
        def process(self, frame):
            return (0.0, np.nan, 0.0)

    assert not tb.check(Broken).is_ok
    with pytest.raises(SystemFailedError, match=r"Broken: .*process returned"):
        tb.run(Broken, drive)


def test_a_trajectory_is_scored_after_alignment(drive: tb.Drive) -> None:
    truth = drive.recorded.reference.trajectory
    assert truth is not None
    moved = Trajectory(truth.stamps, se2.compose([3.0, -2.0, 1.0], truth.poses))
    assert tb.evaluate(moved, drive).metric("trajectory.ate_rmse_m") == pytest.approx(0.0, abs=1e-9)
    assert tb.evaluate(moved, drive).metric("no.such") is None


def test_faults_change_the_scans_and_keep_the_truth(drive: tb.Drive) -> None:
    harder = tb.perturb(drive, drop_scans=0.5)
    scans = [sum(frame.scan is not None for frame in one.frames) for one in (drive, harder)]
    assert 0.2 * scans[0] < scans[1] < 0.8 * scans[0]
    assert tb.run("odometry", harder).metric("trajectory.ate_rmse_m") > 0.0
    assert [frame.stamp for frame in tb.perturb(drive, drop_scans=0.0).frames] == [f.stamp for f in drive.frames]
    sight = [one.recorded.reference.observable.sum() for one in (drive, tb.perturb(drive, drop_scans=0.95))]
    assert sight[1] < sight[0]  # of what no scan is left, no map can know
    with pytest.raises(ValueError, match="drop-scan: no such perturbation"):
        tb.perturb(drive, drop_scan=0.5)


def test_a_dataset_is_read_with_its_truth(tmp_path: Path) -> None:
    command = ("simulate", "office", "--backend", "fast", "--duration", 6, "--lidar", "lds01", "--seed", 3)
    assert call(*command, "--out", tmp_path / "data") == 0
    (folder,) = (tmp_path / "data").iterdir()
    with undrawn():
        assert call("slam", folder, "--system", "scan-matching", "--out", tmp_path / "out") == 0
    read = tb.read(folder)
    found = tb.run("scan-matching", read)
    expected = json.loads((tmp_path / "out" / "scan-matching" / "metrics.json").read_text())
    assert found.metrics["result_hash"] == expected["result_hash"]
    assert found.metrics["trajectory"]["ate_rmse_m"] == expected["trajectory"]["ate_rmse_m"]
    assert found.metrics["map"] == expected["map"]
    assert "true path, true map" in repr(read)


def test_results_show_themselves(drive: tb.Drive) -> None:
    result = tb.run("scan-matching", drive)
    for shown in (drive, result, tb.compare([result, result]), tb.systems(), tb.check(Wheels)):
        page = shown._repr_html_()
        assert page.count("<table") == page.count("</table>")
        assert "<img" in page or "<table" in page
    assert "scan-matching" in result._repr_html_()
    assert "&lt;Drive office" in drive._repr_html_()


def test_a_drive_is_compared_with_what_was_made_of_it_only(drive: tb.Drive) -> None:
    harder = tb.perturb(tb.perturb(drive, askew=5), drop_scans=0.2)
    results = [tb.run("odometry", one) for one in (drive, harder)]
    assert tb.compare(results).names == ("odometry, as driven", "odometry, askew 5, drop-scans 0.2")
    assert "odometry, askew 5, drop-scans 0.2" in tb.compare(results)._repr_html_()
    assert tb.compare(results[1:]).names == ("odometry",)
    other = tb.evaluate(results[0].trajectory, replace(drive, name="another", origin="another"))
    with pytest.raises(
        ValueError, match='results of "another"; "office, seed 3": expected those of one drive, or of a'
    ):
        tb.compare([results[0], other])


def test_the_format_of_a_program_is_chosen(drive: tb.Drive, tmp_path: Path) -> None:
    program = tmp_path / "wheels.py"
    program.write_text(
        "import sys, pathlib\n"
        "from testbed.formats.parquet import read_parquet\n"
        "from eval.files.tum import write_tum\n"
        "from eval.trajectory.trajectory import Trajectory\n"
        "table = read_parquet(pathlib.Path(sys.argv[1])).table\n"
        "write_tum(pathlib.Path(sys.argv[2]) / 'trajectory.tum', Trajectory(table.stamps, table.odometry))\n"
    )
    result = tb.run(f"{sys.executable} {program} {{dataset}} {{out}}", drive, format="parquet")
    expected = tb.run("odometry", drive).metric("trajectory.ate_rmse_m")
    assert result.metric("trajectory.ate_rmse_m") == pytest.approx(expected, abs=1e-5)


@pytest.fixture
def here(tmp_path: Path, monkeypatch) -> Iterator[Path]:
    """A directory with a world, in which commands compute in this process."""
    room_file(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sweep_options, "run_locally", computed_here)
    with undrawn():
        yield tmp_path


def test_a_sweep_and_a_stress_test_show_their_pages(here: Path) -> None:
    swept = tb.sweep(["room.toml"], systems=["odometry"], seeds=2, out="swept", settings={"duration": 5}, workers=1)
    assert swept.table.error.shape == (1, 1, 1, 2)
    assert "iframe" in swept._repr_html_()
    assert repr(swept.table).startswith(
        "<SweepTable of trajectory.ate_rmse_m: 1 place, 1 line, 1 count, 2 seeds; 2 of 2"
    )
    assert repr(swept).splitlines()[0] == f"<Report {Path('swept/sweep.html')}>"
    assert "odometry" in repr(swept)
    assert len(repr(swept)) < 1000
    assert "<td>odometry</td>" in (html_of(swept.table) or "")
    stressed = tb.stress(
        ["odometry"], ["room.toml"], perturbations=["askew"], seeds=1, duration=5, out="stressed", workers=1
    )
    assert [run.perturbation for run in stressed.runs] == ["none", "askew"]
    assert "iframe" in stressed._repr_html_()
    assert "askew" in repr(stressed)
