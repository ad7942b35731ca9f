# SPDX-License-Identifier: MIT
"""The progress display of a sweep: time left follows the work, not the jobs, since jobs differ a hundredfold."""

from dataclasses import replace

import pytest
from rich.console import Console

from eval.sweep.measure import Measure
from testbed.cli.shared import sweep_progress
from testbed.cli.shared.sweep_progress import SweepProgress
from testbed.sweep.execution.local_pool import Finished, Started
from testbed.sweep.forecast import REPORT_SECONDS
from testbed.sweep.result import CellResult
from testbed.sweep.spec.plan import Costs
from tests.testbed.sweep.room import room_cell, room_file

MEASURE = Measure("trajectory_filter.ate_rmse_m")


@pytest.fixture
def clock(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(sweep_progress.time, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def cells(tmp_path):
    cell = room_cell(room_file(tmp_path))
    return [replace(cell, particles=n) for n in (91, 41, 1)]  # 100, 50 and 10 with what does not depend on particles


def shown(progress) -> list[str]:
    console = Console(width=120)
    with console.capture() as capture:
        console.print(progress)
    return capture.get().splitlines()


def result(error, outcome="ok"):
    metrics = {"trajectory_filter": {"ate_rmse_m": error}, "outcome_filter": outcome, "outcome": "ok"}
    return CellResult(metrics, {}, {})


def test_time_left_follows_the_work_and_failures_are_named(cells, clock, capsys):
    progress = SweepProgress(cells, Costs({cells[0].place: 1.0}), MEASURE, worst=False)
    progress.event(Started(cells[0]))
    progress.event(Started(cells[1]))
    clock[0] += 60.0
    progress.event(Finished(cells[0], "time limit of 60 s"))
    line, _, running = shown(progress)[:3]
    left = round(36.0 + REPORT_SECONDS)
    assert line == f"1 of 3 jobs, 0:00:{left} left (with report), 1 without a result"
    assert running.split("  ") == [str(cells[1]), "60 s"]
    assert f"failed: {cells[0]}: time limit of 60 s" in capsys.readouterr().err


def test_lost_runs_are_counted_and_their_repetition_takes_time(cells, clock):
    lines = {}
    for worst in (False, True):
        progress = SweepProgress(cells, Costs({cells[0].place: 1.0}), MEASURE, worst=worst)
        clock[0] += 60.0
        progress.event(Finished(cells[0], result(0.5, "lost")))
        lines[worst] = shown(progress)[0]
    assert lines[False] == "1 of 3 jobs, 0:00:44 left (with report), 1 of them ended lost or broken"
    assert lines[True] == "1 of 3 jobs, 0:02:44 left (with report and worst runs), 1 of them ended lost or broken"


def test_medians_so_far_stand_by_world_and_count(cells, clock):
    progress = SweepProgress(cells, Costs({cells[0].place: 1.0}), MEASURE, worst=False)
    clock[0] += 60.0
    for cell, error in ((cells[0], 0.02), (cells[0], 0.04), (cells[2], 0.5)):
        progress.event(Finished(cell, result(error)))
    head, row = shown(progress)[-2:]
    assert head.split() == ["trajectory", "error", "so", "far,", "cm", "1", "91"]
    assert row.split() == [cells[0].place, "50.0", "3.0"]
