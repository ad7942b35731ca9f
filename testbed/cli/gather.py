# SPDX-License-Identifier: MIT
"""`testbed gather`."""

from __future__ import annotations

from pathlib import Path

from testbed.cli.console import console, results
from testbed.cli.status import GATE_FAILED
from testbed.sweep.gather import gather as gather_tables
from testbed.sweep.store import SweepDirectory

NAMED = 20
"""Cells without a result that are named one by one."""


def gather(sweep: Path, /) -> int:
    """Make tables and the report of a sweep from its cells; exit with 1 if any are missing or failed.

    Parameters
    ----------
    sweep
        Directory that `testbed sweep` wrote, in one go or in shards.
    """
    return gather_and_report(SweepDirectory.open(sweep))


def gather_and_report(directory: SweepDirectory) -> int:
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
    return 0 if gathered.complete else GATE_FAILED
