# SPDX-License-Identifier: MIT
"""`testbed gather`."""

from __future__ import annotations

from pathlib import Path

from eval.sweep.report import write_sweep_report
from eval.sweep.results import read_sweep
from eval.sweep.summary import worst_runs
from testbed.cli.shared.console import announce_compilation, console, progress_line, results
from testbed.cli.shared.status import GATE_FAILED
from testbed.sweep.errors import SweepError
from testbed.sweep.execution.compute import check_inputs
from testbed.sweep.gather import gather as gather_tables
from testbed.sweep.rerun_worst import is_recorded, record
from testbed.sweep.store import SweepDirectory

NAMED = 20
"""Cells without a result that are named one by one."""


def gather(sweep: Path, /, *, worst: bool = True) -> int:
    """Make tables and the report of a sweep from its cells; exit with 1 if any are missing or failed.

    Parameters
    ----------
    sweep
        Directory that `testbed sweep` wrote, in one go or in shards.
    worst
        Carry out the worst runs again, for a recording and a report of their own.
    """
    return gather_and_report(SweepDirectory.open(sweep), worst=worst)


def gather_and_report(directory: SweepDirectory, *, worst: bool) -> int:
    """Write tables and report, name what is not there, return the exit status."""
    gathered = gather_tables(directory)
    absent = [f"failed: {cell}: {reason}" for cell, reason in gathered.failed]
    absent += [f"missing: {cell}" for cell in gathered.missing]
    for line in absent[:NAMED]:
        console.print(line, soft_wrap=True, markup=False)
    if len(absent) > NAMED:
        console.print(f"… and {len(absent) - NAMED} more: column `status` of {directory.path / 'sweep.parquet'}")
    results.print(
        f"{directory.path}: {gathered.done} cells done, {len(gathered.failed)} failed, {len(gathered.missing)} missing"
    )
    if worst:
        _record_worst(directory)
    if gathered.done:
        results.print(f"report: {write_sweep_report(directory.path).resolve()}")
    return 0 if gathered.complete else GATE_FAILED


def _record_worst(directory: SweepDirectory) -> None:
    """Carry out the worst runs again; that this cannot be done is no reason to go without a report."""
    cells = {cell.key: cell for cell in directory.manifest.cells()}
    for run in worst_runs(read_sweep(directory.path)):
        cell = cells[run.key]
        if is_recorded(directory, cell):
            continue
        try:
            check_inputs(cell)
            announce_compilation()
            with progress_line() as watcher:
                same = record(directory, cell, watcher)
        except (SweepError, OSError) as error:
            console.print(f"the worst runs are not recorded: {error}", soft_wrap=True, markup=False)
            return
        if not same:
            console.print(f"{cell}: came out differently than in the sweep", soft_wrap=True, markup=False)
