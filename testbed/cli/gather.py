# SPDX-License-Identifier: MIT
"""`testbed gather`."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from eval.sweep.report import write_sweep_report
from eval.sweep.results import read_sweep
from eval.sweep.summary import worst_runs
from eval.sweep.systems_page import write_systems_page
from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import announce_compilation, console, progress_line, results
from testbed.cli.shared.status import GATE_FAILED
from testbed.cli.shared.sweep_answers import say_answers, say_systems
from testbed.sweep.errors import SweepError
from testbed.sweep.execution.compute import check_inputs
from testbed.sweep.gather import gather as gather_tables
from testbed.sweep.looks import statuses
from testbed.sweep.rerun_worst import is_recorded, rerun
from testbed.sweep.store import SweepDirectory

MAX_NAMED = 20
"""Largest number of jobs without a result that are listed by name."""


def gather(sweep: Path, /, *, worst: bool = True) -> int:
    """Write tables and report of a sweep from the jobs that are done; exit with 1 if any are missing or failed.

    Parameters
    ----------
    sweep
        Directory that `testbed sweep` wrote, at once or in shards.
    worst
        Repeat the worst runs that failed, or were three times worse than usual, with a recording and a report each.
    """
    return gather_and_report(SweepDirectory.open(sweep), worst=worst)


def gather_and_report(directory: SweepDirectory, *, worst: bool, lists_missing: bool = True) -> int:
    """Write tables and report, list the jobs without a result, return the exit status."""
    AT_WORK.now_doing("gathering the results")
    gathered = gather_tables(directory, statuses(directory))
    for cell, reason in gathered.failed[:MAX_NAMED]:
        console.print(f"failed: {cell}: {reason}", soft_wrap=True, markup=False)
    for cell in gathered.missing[: MAX_NAMED if lists_missing else 0]:
        console.print(f"missing: {cell}", soft_wrap=True, markup=False)
    if max(len(gathered.failed), len(gathered.missing) * lists_missing) > MAX_NAMED:
        console.print(f"… and more: column `status` of {directory.path / 'sweep.parquet'}")
    results.print(
        f"{directory.path}: {gathered.done} jobs done, {len(gathered.failed)} failed, {len(gathered.missing)} missing"
    )
    if worst:
        _rerun_worst(directory)
    if gathered.done:
        console.print("writing the report …")
        AT_WORK.now_doing("writing the report")
        say = partial(results.print, soft_wrap=True, markup=False)
        if directory.manifest.spec.names_systems:
            page = write_systems_page(directory.path).resolve()
            say_systems(directory.path, say)
        else:
            page = write_sweep_report(directory.path).resolve()
            say_answers(directory.path, say, is_end=True)
        results.print(f"report: {page}")
    return 0 if gathered.complete else GATE_FAILED


def _rerun_worst(directory: SweepDirectory) -> None:
    """Repeat the worst runs that failed or are unusual. If that is impossible the report is written without them."""
    cells = {cell.key: cell for cell in directory.cells()}
    unusual = [cells[run.key] for run in worst_runs(read_sweep(directory.path)) if run.is_unusual]
    waiting = [cell for cell in unusual if not is_recorded(directory, cell)]
    for number, cell in enumerate(waiting, start=1):
        console.print(f"repeating run {number} of {len(waiting)} that failed: {cell} …", markup=False)
        try:
            check_inputs(cell)
            announce_compilation()
            with progress_line() as watcher:
                same = rerun(directory, cell, watcher)
        except (SweepError, OSError) as error:
            console.print(f"the worst runs cannot be repeated: {error}", soft_wrap=True, markup=False)
            return
        if not same:
            console.print(
                f"{cell}: the repeated run differs from the sweep (another processor or library version?)",
                soft_wrap=True,
                markup=False,
            )
