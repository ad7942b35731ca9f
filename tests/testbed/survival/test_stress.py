# SPDX-License-Identifier: MIT
"""`testbed stress`: a toy system with a known threshold, and stress tests that are interrupted and continued."""

from __future__ import annotations

import json
import shlex
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from eval.survival.results import Run, read_runs, thresholds
from testbed.cli.shared import sweep_options
from testbed.cli.stress import StressOptions
from testbed.formats import open_log
from testbed.stress.table import PERTURBATIONS
from testbed.sweep.execution.compute import compute
from testbed.sweep.execution.local_pool import Event, Finished
from testbed.sweep.spec.cell import Cell
from tests.cheaper import computed_here, undrawn
from tests.shell import assert_refused, call
from tests.testbed.recordings import write_frames
from tests.testbed.sweep.room import room_file

pytestmark = pytest.mark.usefixtures("without_pictures")
TOY = '''
import numpy as np

class Toy:
    """Knows the path by the wheels, and invents one as soon as too few beams are left."""

    name, version = "toy", "1"
    least = {least}

    def start(self, lidars, seed):
        self.scans = 0

    def process(self, frame):
        if frame.scan is None:
            return None
        self.scans += 1
        if np.isfinite(frame.scan.ranges).mean() < self.least:
            return (float(self.scans % 7), 0.0, 0.0)
        return frame.odometry

    def finish(self):
        return None, None
'''
TOYS = "toys.py:Toy,toys.py:Tough"
OPTIONS = ("--worlds", "room.toml", "--perturbations", "dropout,askew", "--workers", 1)
LONG, SHORT, SINGLE = (("--seeds", seeds, "--duration", seconds) for seeds, seconds in ((8, 8), (3, 5), (1, 5)))


def write_inputs(folder: Path) -> None:
    """Write a world, and two systems of which one survives a dropout of 0.5 and the other of 0.9."""
    room_file(folder)
    (folder / "toys.py").write_text(TOY.format(least=0.5) + "\n\nclass Tough(Toy):\n    least = 0.1\n")


@pytest.fixture
def toys(tmp_path: Path, monkeypatch, in_this_process: None) -> str:
    """The two systems, run in this process."""
    write_inputs(tmp_path)
    monkeypatch.chdir(tmp_path)
    return TOYS


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """The directory of a finished stress test of three seeds; to be read, not changed."""
    folder = tmp_path_factory.mktemp("made")
    write_inputs(folder)
    with pytest.MonkeyPatch.context() as patch, undrawn():
        patch.setattr(sweep_options, "run_locally", computed_here)
        patch.chdir(folder)
        assert call("stress", TOYS, *OPTIONS, *SHORT, "--out", "whole") == 0
    return folder / "whole"


def stopped_after(runs: int):
    """An executor that is interrupted after so many runs."""
    done = []

    def compute_some(cells: list[Cell], workers: int, limits: object) -> Iterator[Event]:
        for event in computed_here(cells, workers, limits):
            if len(done) == runs:
                raise KeyboardInterrupt
            done.extend([event] * isinstance(event, Finished))
            yield event

    return compute_some


@pytest.mark.slow
def test_the_known_threshold_of_a_toy_lies_in_its_interval(toys: str, tmp_path: Path) -> None:
    assert call("stress", toys, *OPTIONS, *LONG, "--out", "out") == 0
    found = thresholds(read_runs("out"))
    row = PERTURBATIONS["dropout"]
    for system, lost in (("Toy", 0.5), ("Tough", 0.9)):  # without dropout every beam of the room has a range
        interval = found[system, "dropout"]
        assert row.value_at(max(interval.low, 0.0)) < lost < row.value_at(min(interval.high, 1.0))
        assert found[system, "askew"].value > 1.0
    assert found["Toy", "dropout"].value < found["Tough", "dropout"].value
    assert "What Toy survives" in (tmp_path / "out" / "report.html").read_text()


def test_an_interrupted_stress_test_ends_in_the_same_table(toys: str, made: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(made.parent)  # the table holds the path of the world
    parts = made.with_name("parts")
    monkeypatch.setattr(sweep_options, "run_locally", stopped_after(9))
    assert call("stress", toys, *OPTIONS, *SHORT, "--out", "parts") == 130
    assert "9 runs are left; the same command with --out parts continues" in " ".join(capsys.readouterr().err.split())
    assert len(read_runs("parts")) == 9
    assert "9 of 18 runs" in (parts / "report.html").read_text()
    (parts / "cells" / ".killed.1.tmp").mkdir()  # what kill -9 leaves behind
    monkeypatch.setattr(sweep_options, "run_locally", stopped_after(4))
    assert call("stress", toys, *OPTIONS, *SHORT, "--out", "parts") == 130
    monkeypatch.setattr(sweep_options, "run_locally", computed_here)
    assert call("stress", toys, *OPTIONS, *SHORT, "--out", "parts") == 0
    for name in ("stress.parquet", "report.html", "table.md"):
        assert (parts / name).read_bytes() == (made / name).read_bytes()


def test_systems_see_the_same_frames_at_the_same_severity(made: Path) -> None:
    by_drive: dict[tuple, set[str]] = defaultdict(set)
    for run in read_runs(made):
        by_drive[run.perturbation, run.severity, run.seed].add(run.system)
    assert by_drive["none", None, 0] == by_drive["none", None, 1] == {"Toy", "Tough"}
    assert by_drive["dropout", 0.5, 0] == {"Toy", "Tough"}  # the first run of each


def test_the_command_on_the_page_makes_the_same_runs(toys: str, tmp_path: Path, monkeypatch) -> None:
    assert call("stress", toys, *OPTIONS, *SINGLE, "--set", "lidar=lds01", "--out", "out") == 0
    table = (tmp_path / "out" / "stress.parquet").read_bytes()
    command = json.loads(pq.read_schema(tmp_path / "out" / "stress.parquet").metadata[b"stress"])["command"]
    monkeypatch.setattr(sweep_options, "run_locally", stopped_after(0))  # everything is there: nothing may be computed
    program, *words = shlex.split(command)
    assert program == "testbed"
    assert call(*words, "--out", "out") == 0
    assert (tmp_path / "out" / "stress.parquet").read_bytes() == table


def test_a_system_that_raises_has_failed_and_the_others_go_on(toys: str, tmp_path: Path, monkeypatch) -> None:
    def compute_or_fail(cells: list[Cell], workers: int, limits: object) -> Iterator[Event]:
        for cell in cells:
            is_bad = "Tough" in str(cell.settings["system"])
            yield Finished(cell, "Tough: scan 0: out of luck" if is_bad else compute(cell))

    monkeypatch.setattr(sweep_options, "run_locally", compute_or_fail)
    assert call("stress", toys, *OPTIONS, *SINGLE, "--out", "out") == 0
    runs: list[Run] = read_runs("out")
    assert {run.outcome for run in runs if run.system == "Tough"} == {"failed"}
    assert "out of luck" in (tmp_path / "out" / "report.html").read_text()
    assert {run.outcome for run in runs if (run.system, run.perturbation) == ("Toy", "none")} == {"ok"}


def test_the_plan_counts_the_runs_and_writes_nothing(toys: str, tmp_path: Path, capsys) -> None:
    assert call("stress", toys, *OPTIONS, *SHORT, "--out", "out", "--plan") == 0
    said = capsys.readouterr().out
    assert "18 runs: 3 drives (1 worlds, 3 seeds), 2 systems, 2 perturbations and none" in said
    assert "Expected: about" in said
    assert not (tmp_path / "out").exists()


def test_bad_requests_are_refused_before_anything_is_written(toys: str, tmp_path: Path, capsys) -> None:
    def refused(complaint: str, *arguments: object) -> None:
        assert_refused(capsys, complaint, "stress", *arguments, "--out", "out")
        assert not (tmp_path / "out").exists()

    refused("drop-scan: no such perturbation, expected such as drop-scans", toys, "--worlds", "office",
            "--perturbations", "drop-scan")  # fmt: skip
    refused("offic", toys, "--worlds", "offic")
    refused("no-such-system", "no-such-system", "--worlds", "office")
    refused("perturb: is chosen by the stress test", toys, "--worlds", "office", "--set", "perturb=askew=3")
    refused("--shard: expected none", toys, "--worlds", "office", "--shard", "0/2")


def test_a_directory_of_another_stress_test_is_refused(toys: str, made: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(made.parent)
    assert_refused(
        capsys, "holds another sweep", "stress", toys, *OPTIONS, *SHORT, "--set", "lidar=lds01", "--out", made
    )


@pytest.fixture
def log(toys: str, tmp_path: Path) -> str:
    """A drive through the room as a dataset that holds its truth."""
    assert call("simulate", "room.toml", "--backend", "fast", "--duration", 5, "--out", "data") == 0
    return str(next((tmp_path / "data").iterdir()))


def test_logs_take_the_place_of_worlds(toys: str, log: str, tmp_path: Path, monkeypatch) -> None:
    options = ("--perturbations", "dropout,glass", "--workers", 1)
    assert call("stress", toys, "--log", log, *options, "--seeds", 2, "--out", "out") == 0
    runs = read_runs("out")
    assert len(runs) == 2 * 2 * 3
    assert {run.place for run in runs} == {Path(log).name}
    plain = [run for run in runs if run.perturbation == "none"]
    assert {run.outcome for run in plain} == {"ok"}
    for system, survives in (("Toy", 0.5), ("Tough", 0.9)):
        dropouts = [run for run in runs if (run.system, run.perturbation) == (system, "dropout")]
        assert [run.has_failed for run in dropouts] == [run.value > survives for run in dropouts]
    table = (tmp_path / "out" / "stress.parquet").read_bytes()
    command = json.loads(pq.read_schema(tmp_path / "out" / "stress.parquet").metadata[b"stress"])["command"]
    monkeypatch.setattr(sweep_options, "run_locally", stopped_after(0))  # everything is there: nothing may be computed
    assert call(*shlex.split(command)[1:], "--out", "out") == 0
    assert (tmp_path / "out" / "stress.parquet").read_bytes() == table


def test_logs_need_something_to_tell_failures_by(toys: str, log: str, tmp_path: Path, capsys) -> None:
    def refused(complaint: str, *arguments: object) -> None:
        assert_refused(capsys, complaint, "stress", toys, *arguments, "--out", "out")
        assert not (tmp_path / "out").exists()

    bare = tmp_path / "bare.log"
    write_frames(bare, [replace(frame, truth=None) for frame in open_log(log).frames])
    refused("holds no truth to tell failures by", "--log", bare)
    relations = tmp_path / "drive.relations"
    relations.write_text("0 1 0.1 0 0 0 0 0\n")
    refused("glass: needs the true pose at each scan", "--log", f"{bare},relations={relations}",
            "--perturbations", "glass")  # fmt: skip
    refused("expected LOG, LOG,relations=FILE or LOG,truth=FILE", "--log", f"{bare},map=x")
    refused("expected either --worlds or --log", "--log", log, "--worlds", "office")
    refused("expected either --worlds or --log")
    refused("--duration: logs are run as a whole", "--log", log, "--duration", 5)
    options = StressOptions(log=(f"{bare},relations={relations}",))
    assert [row.name for row in options.chosen] == [name for name in PERTURBATIONS if name != "glass"]
    assert len(StressOptions(log=(log,)).chosen) == len(PERTURBATIONS)
