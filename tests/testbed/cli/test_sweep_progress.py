# SPDX-License-Identifier: MIT
"""The live table of a sweep: work done counts, not cells, since cells differ a hundredfold."""

from dataclasses import replace

import pytest
from rich.console import Console

from testbed.cli.shared import sweep_progress
from testbed.cli.shared.sweep_progress import SweepProgress
from testbed.sweep.execution.local_pool import Finished, Started
from testbed.sweep.spec.plan import Costs
from tests.testbed.sweep.room import room_cell, room_file


@pytest.fixture
def clock(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(sweep_progress.time, "monotonic", lambda: now[0])
    return now


def test_time_that_remains_follows_the_work_and_failures_are_told(tmp_path, clock, capsys):
    cell = room_cell(room_file(tmp_path))
    cells = [replace(cell, particles=n) for n in (91, 41, 1)]  # 100, 50 and 10 with what does not depend on particles
    progress = SweepProgress(cells, Costs({cell.place: 1.0}))
    progress.event(Started(cells[0]))
    progress.event(Started(cells[1]))
    clock[0] += 60.0
    progress.event(Finished(cells[0], "time limit of 60 s"))
    console = Console(width=100)
    with console.capture() as capture:
        console.print(progress)
    line, _, running = capture.get().splitlines()[:3]
    assert line == "1 of 3 jobs, 1.0 a minute, 0:00:36 left, 1 failed"
    assert running.split("  ") == [str(cells[1]), "60 s"]
    assert f"failed: {cells[0]}: time limit of 60 s" in capsys.readouterr().err
