# SPDX-License-Identifier: MIT
"""The progress display of a sweep: time left follows the work, not the jobs, since jobs differ a hundredfold."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from rich.console import Console

from eval.sweep.job_times import REPORT_SECONDS, duration_words
from eval.sweep.margin import parse_margin
from eval.sweep.measure import Measure
from eval.sweep.results import read_sweep
from testbed.cli.shared import sweep_progress, time_left
from testbed.cli.shared.sweep_progress import Stage, SweepProgress
from testbed.cli.shared.time_left import TimeLeft
from testbed.sweep.execution.local_pool import Finished, Started
from testbed.sweep.result import CellResult
from testbed.sweep.spec.plan import Costs
from tests.eval.synthetic_sweep import COUNTS, errors_of, write_sweep
from tests.testbed.sweep.room import room_cell, room_file

MEASURE = Measure("trajectory_filter.ate_rmse_m")


@pytest.fixture
def clock(monkeypatch):
    now = [1000.0]
    for module in (sweep_progress, time_left):
        monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
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


def progress_of(cells, *, worst=False, goal="", seconds=None):
    """seconds: expected time of each job by its particles; None: unknown, so that the predicted work is the measure."""
    if seconds is None:
        left = TimeLeft(cells, Costs({cells[0].place: 1.0}), 2, is_in_seconds=False)
    else:
        left = TimeLeft(cells, lambda cell: seconds[cell.particles], 2, is_in_seconds=True)
    return SweepProgress(cells, left, MEASURE, Stage(goal, worst))


def test_while_it_is_silent_the_time_is_that_of_the_whole(cells, monkeypatch):
    """Beside the time left a time since the last job would be misread."""
    said = []
    monkeypatch.setattr(sweep_progress.AT_WORK, "now_doing", lambda line, since: said.append((line, since)))
    monkeypatch.setattr(sweep_progress.time, "perf_counter", lambda: 50.0)
    progress = progress_of(cells)
    monkeypatch.setattr(sweep_progress.time, "perf_counter", lambda: 90.0)
    progress.event(Started(cells[0]))
    progress.event(Finished(cells[0], "no scan"))
    assert [since for _, since in said] == [50.0]
    assert said[0][0].startswith("1 of 3 jobs")


def test_time_left_follows_the_work_and_failures_are_named(cells, clock, capsys):
    progress = progress_of(cells)
    assert shown(progress)[0] == "0 of 3 jobs"
    progress.event(Started(cells[0]))
    progress.event(Started(cells[1]))
    clock[0] += 60.0
    progress.event(Finished(cells[0], "time limit of 60 s"))
    line, _, running = shown(progress)[:3]
    # work of 100 took 60 s, but that of 50 has not ended after 60 s: it counts as if it ended now. That of 10 is left.
    scale = 120.0 / 150.0
    left = duration_words((0.05 * 50 * scale + 10 * scale) / 2 + REPORT_SECONDS)
    assert line == f"1 of 3 jobs, about {left} left (with report), 1 without a result"
    assert running.split("  ") == [str(cells[1]), "60 s"]
    assert f"failed: {cells[0]}: time limit of 60 s" in capsys.readouterr().err


def test_the_time_left_begins_with_the_expected_times_and_counts_down(cells, clock):
    expected = {91: 100.0, 41: 60.0, 1: 40.0}
    left = TimeLeft(cells, lambda cell: expected[cell.particles], 2, is_in_seconds=True)
    progress = SweepProgress(cells, left, MEASURE, Stage("to the look with 8 seeds", worst=False))
    assert shown(progress)[0] == "0 of 3 jobs to the look with 8 seeds, about 2 minutes left"
    progress.event(Started(cells[0]))
    progress.event(Started(cells[1]))
    seen = []
    for second in range(1, 130):
        clock[0] += 1.0
        if second == 70:  # a little late
            progress.event(Finished(cells[1], result(0.1)))
            progress.event(Started(cells[2]))
        if second == 110:
            progress.event(Finished(cells[0], result(0.1)))
        seconds = left.seconds(REPORT_SECONDS)
        assert f"about {duration_words(seconds)} left" in shown(progress)[0]
        seen.append(seconds)
    assert seen[0] == pytest.approx(99.0 + REPORT_SECONDS)
    assert all(later <= earlier for earlier, later in pairwise(seen))
    assert seen[-1] < 15


def test_the_start_of_a_worker_does_not_count_as_a_slow_job(cells, clock):
    progress = progress_of(cells, seconds={91: 10.0, 41: 10.0, 1: 10.0})
    progress.event(Started(cells[0]))
    clock[0] += 30.0
    outcome = CellResult({}, {}, {"cell_s": 10.0})  # it took 20 s until the worker was there
    progress.event(Finished(cells[0], outcome))
    assert f"about {duration_words(10 + REPORT_SECONDS)} left" in shown(progress)[0]


def test_on_a_cluster_the_time_left_follows_the_share_that_is_done(cells, clock):
    left = TimeLeft(cells, Costs({cells[0].place: 1.0}), None, is_in_seconds=False)
    assert left.seconds(0.0) is None
    clock[0] += 60.0
    left.event(Finished(cells[0], result(0.1)))
    assert left.seconds(0.0) == pytest.approx(60.0 * 60.0 / 100.0)


def test_much_slower_jobs_than_expected_raise_the_time_left(cells, clock):
    progress = progress_of(cells, seconds={91: 10.0, 41: 10.0, 1: 10.0})
    before = shown(progress)[0]
    progress.event(Started(cells[0]))
    clock[0] += 300.0
    progress.event(Finished(cells[0], result(0.1)))
    assert "about 30 s left" in before
    assert "about 2 minutes left" in shown(progress)[0]


def test_lost_runs_are_counted_and_their_repetition_takes_time(cells, clock):
    lines = {}
    for worst in (False, True):
        progress = progress_of(cells, worst=worst)
        progress.event(Started(cells[0]))
        clock[0] += 60.0
        progress.event(Finished(cells[0], result(0.5, "lost")))
        lines[worst] = shown(progress)[0]
    # 0.6 s for each of 160, of which 60 are left for two workers; a repetition takes as long as two jobs
    assert lines[False] == "1 of 3 jobs, about 30 s left (with report), 1 of them ended lost or broken"
    assert lines[True] == "1 of 3 jobs, about 90 s left (with report and worst runs), 1 of them ended lost or broken"


def test_medians_so_far_stand_by_world_and_count(cells, clock):
    progress = progress_of([cells[0], cells[2]])
    later = replace(cells[0], seed=77)  # its seed has no result with 1 particle yet
    for cell, error in ((cells[0], 0.02), (later, 0.04), (cells[2], 0.5)):
        progress.event(Finished(cell, result(error)))
    title, head, row = shown(progress)[-3:]
    assert title.strip() == "median trajectory error of the filter, cm (seeds)"
    assert head.split() == ["1", "91"]
    assert row.split() == [cells[0].place, "50.0", "(1)", "2.0", "(1)"]
    progress.event(Finished(replace(cells[2], seed=77), result(0.3)))
    assert shown(progress)[-1].split() == [cells[0].place, "40.0", "(2)", "3.0", "(2)"]


def test_medians_stand_in_the_order_of_the_tables(cells):
    left = TimeLeft(cells, Costs({cells[0].place: 1.0}), 2, is_in_seconds=False)
    stage = Stage("", worst=False, groups=(("loop", "default"), ("apartment", "default")))
    of_places = [replace(cells[0], place=place, line="default") for place in ("apartment", "another", "loop")]
    progress = SweepProgress(of_places, left, MEASURE, stage)
    for cell in of_places:
        progress.event(Finished(cell, result(0.02)))
    assert [line.split(":")[0].strip() for line in progress.median_lines()[1:]] == ["loop", "apartment", "another"]


def test_medians_of_a_world_that_is_not_computed_are_not_repeated(cells):
    """It was given up, or has its answer; a live table, which is drawn anew, keeps it."""
    left = TimeLeft(cells, Costs({cells[0].place: 1.0}), 2, is_in_seconds=False)
    progress = SweepProgress(cells[:1], left, MEASURE, Stage("", worst=False))
    for place in (cells[0].place, "loop"):
        progress.event(Finished(replace(cells[0], place=place), result(0.02)))
    (line,) = progress.median_lines()[1:]
    assert "loop" not in line
    assert progress.medians().row_count == 2


def test_no_medians_are_printed_before_a_seed_has_all_counts(cells):
    progress = progress_of(cells)
    progress.event(Finished(cells[0], result(0.02)))
    assert progress.median_lines() == []
    for cell in cells[1:]:
        progress.event(Finished(cell, result(0.02)))
    assert len(progress.median_lines()) == 2


def test_runs_that_were_there_before_count_among_the_medians(cells, tmp_path):
    progress = progress_of([replace(cell, particles=n) for cell, n in zip(cells, COUNTS, strict=True)])
    progress.note_table(read_sweep(write_sweep(tmp_path / "before")))
    for count in COUNTS:
        cell = replace(cells[0], place="cave", line="improved", particles=count, seed=77)
        progress.event(Finished(cell, result(1.0)))
    rows = {line.rsplit(maxsplit=6)[0]: line.split()[-6:] for line in shown(progress)[-4:]}
    assert list(rows) == ["cave, improved", "cave, motion", "hall_a, improved", "hall_a, motion"]
    errors = [*(errors_of(1, 0, 1, s) for s in range(10)), 1.0]
    assert rows["cave, improved"][2:4] == [f"{100 * np.median(errors):.1f}", "(11)"]


def test_after_two_seeds_the_margin_is_said_as_a_share_of_the_error(cells, clock, capsys):
    """Of the error with the largest count alone, once a world; runs of a sweep that goes on count too."""
    stage = Stage("", worst=False, margin=parse_margin("5mm"))
    seeds = [replace(cell, seed=seed) for seed in range(4) for cell in cells]
    progress = SweepProgress(seeds, TimeLeft(seeds, lambda cell: 1.0, 2, is_in_seconds=True), MEASURE, stage)
    said = []
    for cell in seeds:
        progress.event(Started(cell))
        progress.event(Finished(cell, result({91: 0.01 + 0.002 * cell.seed, 41: 0.3, 1: 0.3}[cell.particles])))
        said.append(capsys.readouterr().err)
    assert [number for number, text in enumerate(said) if "margin: " in text] == [5]
    assert "the error with 91 is about 1.1 cm in the first 2 seeds, of which the margin of 0.5 cm is 45 %" in said[5]


def test_what_is_known_of_a_margin_is_not_said_again(cells, clock, capsys, tmp_path):
    table = read_sweep(write_sweep(tmp_path, seeds=2))
    place, line = table.places[0], table.lines[0]
    own = [replace(cells[0], place=place, line=line, particles=count, seed=2) for count in COUNTS]
    stage = Stage("", worst=False, margin=parse_margin("5mm"))
    progress = SweepProgress(own, TimeLeft(own, lambda cell: 1.0, 2, is_in_seconds=True), MEASURE, stage)
    progress.note_table(table)
    for cell in own:
        progress.event(Started(cell))
        progress.event(Finished(cell, result(0.01)))
    assert "margin: " not in capsys.readouterr().err
