# SPDX-License-Identifier: MIT
"""Sweeps over SLAM systems: the same frames for all, failures that stay alone, resumption, the page."""

import html
import json
import re
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from eval.sweep.results import read_sweep
from eval.sweep.summary import summarise
from eval.sweep.systems_page import failed_runs, place_tables
from testbed.sweep.execution.compute import compute
from testbed.sweep.spec.plan import file_digest
from testbed.sweep.spec.spec import SweepSpec, parse_spec
from testbed.sweep.store import SweepDirectory
from tests.shell import assert_refused, call
from tests.testbed.sweep.room import room_cell, room_file

SYSTEM = """
class Wheels:
    name, version = "wheels", "1"
    def start(self, lidars, seed): pass
    def process(self, frame): return frame.odometry
    def finish(self): return None, None

class Moody(Wheels):
    def start(self, lidars, seed):
        if seed == 1:
            raise RuntimeError("not today")
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("systems")
    room_file(folder)
    (folder / "mine.py").write_text(SYSTEM)
    return folder


def sweep_of(folder: Path, out: str, *options: object, systems: str = "odometry,gmapping,{mine}:Moody") -> int:
    (world,) = folder.glob("*.toml")
    named = systems.format(mine=folder / "mine.py")
    fixed = ("--worlds", world, "--system", named, "--particles", "3", "--seeds", "3", "--no-worst", "--workers", "2")
    return call("sweep", *fixed, "--out", folder / out, *options)


@pytest.fixture(scope="module")
def swept(folder) -> Path:
    assert sweep_of(folder, "swept") == 1  # one job of Moody fails
    return folder / "swept"


def test_all_systems_of_a_seed_see_one_drive(swept):
    rows = pq.read_table(swept / "sweep.parquet").to_pylist()
    assert [row["line"] for row in rows] == [name for name in ("odometry", "gmapping", "Moody") for _ in range(3)]
    for seed in range(3):
        of_seed = [row for row in rows if row["seed"] == seed and row["status"] == "done"]
        assert len({row["trajectory.odometry.ate_rmse_m"] for row in of_seed}) == 1
        wheels = next(row for row in of_seed if row["line"] == "odometry")
        assert wheels["trajectory.ate_rmse_m"] == wheels["trajectory.odometry.ate_rmse_m"]
    assert len({row["trajectory.odometry.ate_rmse_m"] for row in rows if row["status"] == "done"}) == 3


def test_cpu_time_is_measured_of_systems_that_are_followed_and_of_others(swept):
    """It does not grow where other work delays the runs, as the time by the clock does."""
    seconds = read_sweep(swept).cube("cpu_s")[0, :, 0]
    done = np.isfinite(read_sweep(swept).error[0, :, 0])
    assert (seconds[done] > 0.0).all()
    assert np.nanmedian(seconds[1]) > 10.0 * np.nanmedian(seconds[0])  # the filter and the odometry


def test_a_failing_system_is_a_failed_job_with_its_reason(swept):
    rows = pq.read_table(swept / "sweep.parquet").to_pylist()
    (failed,) = [row for row in rows if row["status"] == "failed"]
    assert (failed["line"], failed["seed"]) == ("Moody", 1)
    assert "Moody: start raised RuntimeError: not today" in failed["reason"]


def test_the_page_compares_systems_with_the_first(swept):
    summary = summarise(read_sweep(swept).judged())
    (table,) = place_tables(summary)
    assert [row[0] for row in table.rows] == ["odometry", "gmapping", "Moody"]
    assert table.headings[2:5] == ("error, median", "while driving", "minus odometry, paired")
    assert table.rows[0][4] == "(the first system)"
    assert table.rows[0][3] == table.rows[0][2].partition(" (")[0]  # odometry says at the end what it said before
    assert table.rows[1][3] != table.rows[1][2].partition(" (")[0]  # the filter makes a final pass
    assert table.rows[2][1].startswith("1 of 3 (")
    assert "too few to tell" in table.rows[1][4]
    assert all(float(row[5]) > 0.0 for row in table.rows)
    page = (swept / "sweep.html").read_text()
    assert "SLAM systems on the same data" in page
    assert "How many particles" not in page
    assert "| Moody | 1 of 3" in (swept / "table.md").read_text()


def test_of_few_runs_the_range_stands_where_others_have_an_interval(swept):
    table = read_sweep(swept).judged()
    rows = place_tables(summarise(table))[0].rows
    low, high = (100.0 * value for value in (table.error[0, 0, 0].min(), table.error[0, 0, 0].max()))
    assert re.fullmatch(rf".* \(all 3 runs: {low:.1f}\d* to {high:.1f}\d*\)", rows[0][2])
    assert "(all 2 runs: " in rows[2][2]  # the third has no result


def test_the_page_says_why_runs_failed(swept):
    table = read_sweep(swept).judged()
    ((place, system, seeds, reason),) = failed_runs(table)
    assert (place, system, seeds) == (table.places[0], "Moody", "1")
    assert "start raised RuntimeError: not today" in reason
    assert "start raised RuntimeError: not today" in html.unescape((swept / "sweep.html").read_text())


def test_a_run_that_ended_badly_has_the_reason_of_its_outcome(swept):
    """Seeds with the same reason share a row; without one the outcome stands there."""
    table = read_sweep(swept).judged()
    outcome, why = (table.columns[name].copy() for name in ("outcome", "outcome_reason"))
    outcome[0, 0, 0, 1:], why[0, 0, 0, 1:] = "lost", "spans only 32% of the path"
    outcome[0, 1, 0, 0], why[0, 1, 0, 0] = "collided", None
    changed = replace(table, columns={**table.columns, "outcome": outcome, "outcome_reason": why})
    assert [row[1:] for row in failed_runs(changed)[:2]] == [
        ("odometry", "1, 2", "spans only 32% of the path"),
        ("gmapping", "0", "ended collided"),
    ]


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.usefixtures("without_pictures")
def test_the_same_sweep_in_pieces_gives_the_same_bytes(folder, swept):
    assert sweep_of(folder, "pieces", "--shard", "0/2") in (0, 1)
    directory = SweepDirectory.open(folder / "pieces")
    done = {cell.key for cell in directory.manifest.cells() if directory.is_done(cell.key)}
    assert 0 < len(done) < 9
    assert sweep_of(folder, "pieces") == 1
    assert (folder / "pieces" / "sweep.parquet").read_bytes() == (swept / "sweep.parquet").read_bytes()


def test_the_filter_as_a_system_is_the_filter(folder):
    (world,) = folder.glob("*.toml")
    cell = room_cell(world)
    as_system = replace(cell, settings={**cell.settings, "system": "gmapping"})
    assert compute(as_system).metrics == compute(cell).metrics


def test_a_system_of_a_file_counts_by_content(folder, tmp_path):
    def key(text: str, at: Path) -> str:
        at.parent.mkdir(exist_ok=True)
        at.write_text(text)
        (world,) = folder.glob("*.toml")
        cell = room_cell(world)
        settings = {**cell.settings, "system": f"{at}:Wheels"}
        return replace(cell, settings=settings, inputs={**cell.inputs, str(at): file_digest(at)}).key

    first = key(SYSTEM, tmp_path / "a" / "mine.py")
    assert key(SYSTEM, tmp_path / "b" / "yours.py") == first
    assert key(SYSTEM + "# changed\n", tmp_path / "a" / "mine.py") != first


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.usefixtures("without_pictures")
def test_a_program_is_a_line(folder, tmp_path):
    script = tmp_path / "theirs.py"
    script.write_text("import sys; print('no licence', sys.argv[1][-4:]); sys.exit(4)")
    command = f"{shlex.quote(sys.executable)} {script} {{dataset}} {{out}}"
    (world,) = folder.glob("*.toml")
    fixed = ("--worlds", world, "--seeds", "1", "--no-worst", "--workers", "1", "--system-format", "carmen")
    assert call("sweep", *fixed, "--system", "odometry", "--system-command", command, "--out", tmp_path / "out") == 1
    rows = pq.read_table(tmp_path / "out" / "sweep.parquet").to_pylist()
    assert [(row["line"], row["status"], row["particles"]) for row in rows] == [
        ("odometry", "done", 30),
        ("theirs", "failed", 30),
    ]
    assert "theirs: ended with exit status 4, expected status 0; its last lines: no licence .log" in rows[1]["reason"]


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.usefixtures("without_pictures")
def test_a_worst_run_is_repeated_with_its_system(folder):
    out = folder / "worst"
    (world,) = folder.glob("*.toml")
    wheels = f"{folder / 'mine.py'}:Wheels"
    options = ("--set", "odometry.grade=poor", "--set", "odometry.slip_rate=0.3", "--seeds", "1", "--workers", "1")
    assert call("sweep", "--worlds", world, "--system", wheels, *options, "--out", out) == 0
    for metrics in out.glob("worst/*/metrics.json"):
        assert json.loads(metrics.read_text())["system"]["name"] == "wheels"
    (row,) = pq.read_table(out / "sweep.parquet").to_pylist()
    assert np.isfinite(row["trajectory.ate_rmse_m"])


@pytest.mark.parametrize(
    ("document", "complaint"),
    [
        ({"particles": [1, 5]}, "expected one count, since systems are compared"),
        ({"until": "decided", "particles": [5]}, "asks how many particles are enough"),
    ],
)
def test_questions_about_particles_are_refused(document, complaint):
    with pytest.raises(ValueError, match=complaint):
        parse_spec({"worlds": ["lab"], "axes": {"system": ["odometry", "gmapping"]}, **document}, "here", Path())


def test_systems_are_measured_by_their_final_estimates():
    spec = SweepSpec(worlds=("lab",), particles=(5,), axes={"system": ("odometry", "a/mine.py:Mine")})
    assert spec.key_measure == "trajectory.ate_rmse_m"
    assert [line.name for line in spec.lines()] == ["odometry", "Mine"]


def test_an_unknown_system_is_refused_before_anything_is_computed(folder, capsys):
    (world,) = folder.glob("*.toml")
    complaint = "system 'gmaping': unknown"
    assert_refused(capsys, complaint, "sweep", "--worlds", world, "--system", "gmaping", "--out", folder / "none")
    assert not (folder / "none").exists()
