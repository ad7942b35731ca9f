# SPDX-License-Identifier: MIT
"""`testbed sweep`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Annotated

from eval.sweep.job_times import duration_words
from eval.sweep.margin import parse_margin
from eval.sweep.measure import Measure
from eval.sweep.regression_check import compare_with_baseline, write_baseline
from eval.sweep.results import read_sweep
from testbed.cli.gather import gather_and_report
from testbed.cli.shared.console import announce_compilation, console, results
from testbed.cli.shared.output import FLAG
from testbed.cli.shared.status import GATE_FAILED, INTERRUPTED
from testbed.cli.shared.sweep_announcement import Work, announce, done_so_far
from testbed.cli.shared.sweep_looks import say_look
from testbed.cli.shared.sweep_options import EXECUTION, REGRESSION, REQUEST, Execution, RegressionOptions, SweepOptions
from testbed.cli.shared.sweep_progress import Stage, SweepProgress, sweep_progress
from testbed.cli.shared.sweep_suggestion import print_suggestion
from testbed.cli.shared.time_left import TimeLeft
from testbed.run.run_directory import default_directory
from testbed.sweep.errors import SweepError
from testbed.sweep.execute import check_code, execute, pending, prepare
from testbed.sweep.forecast import JobTimes, measured_times
from testbed.sweep.looks import look_at, needed_cells, planned
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.plan import Costs, Shard
from testbed.sweep.spec.spec import SweepSpec
from testbed.sweep.store import SweepDirectory


def sweep(
    spec: Path | None = None,
    /,
    *,
    request: SweepOptions = REQUEST,
    out: Path | None = None,
    execution: Execution = EXECUTION,
    worst: bool = True,
    gate: RegressionOptions = REGRESSION,
    plan: Annotated[bool, FLAG] = False,
    suggest: str | None = None,
) -> int:
    """Measure accuracy against particle count over worlds or logs, seeds and variants, with confidence intervals.

    Parameters
    ----------
    spec
        TOML file with the specification (docs/sweep.md).
    out
        Directory of the sweep; an unfinished sweep in it is completed. Default: a new one in runs/.
    worst
        At the end repeat the worst runs that failed, or were three times worse than usual, with a recording and a
        report each.
    plan
        Print what would be computed, how long it would take and what it could tell, and stop.
    suggest
        World or log: print how many particles to take for it and why, from the experiment of docs/study.md, and stop.
        --set NAME=VALUE and --route (default: random) describe robot, lidar, odometry and route of a world.
    """
    if suggest is not None:
        if spec is not None or replace(request, set=(), route=None) != REQUEST:
            raise SweepError(f"--suggest {suggest}: takes --set and --route only")
        return print_suggestion(suggest, request.own_settings())
    if spec is None and request == REQUEST and gate.is_requested:
        request = SweepOptions(preset="gate")
    specification = request.specification(spec, out)
    part = execution.part
    if part is not None and specification.until:
        raise SweepError("--shard and --until: expected one of them, since a shard does not know the results of others")
    if plan:
        _announce_plan(specification, out, execution)
        return 0
    directory, costs = prepare(out or default_directory("sweep", datetime.now()), specification)
    with directory.locked(part):
        try:
            cells = _compute(directory, costs, execution, worst=worst)
        except KeyboardInterrupt:
            return _interrupted(directory, costs, part)
    if part is not None:
        failed = sum(directory.reason(cell.key) is not None for cell in cells)
        results.print(
            f"{directory.path}: shard {part} is done, {failed} jobs failed; after the last shard run: testbed gather"
        )
        return GATE_FAILED if failed else 0
    status = gather_and_report(directory, worst=worst)
    if gate.update_baseline:
        write_baseline(read_sweep(directory.path), gate.baseline)
        results.print(f"baseline: {gate.baseline}")
    return max(status, _compare(directory.path, gate.baseline)) if gate.check else status


def _announce_plan(spec: SweepSpec, out: Path | None, execution: Execution) -> None:
    """Say what would be computed; nothing is written."""
    done = done_so_far(out, spec)
    plan = planned(out, spec, done)
    work = Work(spec, Costs.of(spec), plan.needed, plan.possible, plan.next_look, done, plan.finished)
    announce(work, execution, is_plan=True)


def _compute(directory: SweepDirectory, costs: Costs, execution: Execution, *, worst: bool) -> list[Cell]:
    """Compute the jobs up to each look at the results, until no more are needed; returns those of the first stage."""
    spec, part, workers = directory.manifest.spec, execution.part, execution.worker_count
    look = look_at(directory)
    first = cells = pending(directory, look.needed, costs, part)
    rest = pending(directory, look.possible, costs, part)
    done = done_so_far(directory.path, spec)
    finished = sum(directory.is_done(cell.key) for cell in directory.cells())
    times = announce(Work(spec, costs, cells, rest, look.seeds, done, finished), execution)
    if cells and execution.scheduler is None:
        announce_compilation()  # after the plan: it may take minutes
    groups = tuple(dict.fromkeys((cell.place, cell.line) for cell in directory.cells()))
    tried: set[str] = set()
    while cells:
        is_last = len(cells) == len(rest)
        goal = "" if is_last else f"to the look with {look.seeds} seeds"
        stage = Stage(goal, worst and is_last, groups, None if spec.names_systems else parse_margin(spec.margin))
        expected, at_once = costs if times is None else times.seconds_of, None if execution.scheduler else workers
        left = TimeLeft(cells, expected, at_once, is_in_seconds=times is not None)
        progress = SweepProgress(cells, left, Measure(spec.key_measure), stage)
        if done is not None:
            progress.note_table(done)
        with sweep_progress(progress):
            execute(directory, cells, execution.executor, progress)
        if not spec.until:
            break
        tried |= {cell.key for cell in cells}
        look = look_at(directory)
        cells = [cell for cell in pending(directory, look.needed, costs, part) if cell.key not in tried]
        rest = [cell for cell in pending(directory, look.possible, costs, part) if cell.key not in tried]
        done = read_sweep(directory.path)
        times = measured_times(done, rest, costs) or times
        if cells:
            say_look(directory, look.seeds, cells, rest, partial(_duration, times, workers))
            check_code(directory)
    return first


def _duration(times: JobTimes | None, workers: int, cells: Sequence[Cell]) -> str:
    return "" if times is None else duration_words(times.total(cells, workers))


def _interrupted(directory: SweepDirectory, costs: Costs, part: Shard | None) -> int:
    """Leave a report of what there is, and say how to go on."""
    with suppress(KeyboardInterrupt):
        left = len(pending(directory, needed_cells(directory), costs, part))
        goal = " to the next look" if directory.manifest.spec.until else ""
        console.print(
            f"interrupted: {left} jobs are left{goal}; testbed sweep --out {directory.path} continues with them",
            soft_wrap=True,
        )
        if part is None:
            gather_and_report(directory, worst=False, lists_missing=False)
    return INTERRUPTED


def _compare(directory: Path, baseline: Path) -> int:
    """Print how accuracy compares with the baseline; returns the exit status."""
    comparisons = compare_with_baseline(read_sweep(directory), baseline)
    for c in comparisons:
        word = "worse" if c.worse else "better: renew the baseline" if c.better else "as before"
        results.print(f"{c.name}: {c.factor:.2f} times the baseline's error, up to {c.allowed:.2f} is noise: {word}")
    return GATE_FAILED if any(c.worse for c in comparisons) else 0
