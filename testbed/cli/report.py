# SPDX-License-Identifier: MIT
"""`testbed report`."""

from __future__ import annotations

from pathlib import Path

from eval.report.comparison import write_comparison
from eval.report.run_report import write_report
from testbed.cli.shared.console import results
from testbed.views import moments_for_report


def report(runs: list[Path], /, *, out: Path = Path("comparison.html")) -> None:
    """Rewrite the report of a run from its files, or compare several runs side by side.

    Parameters
    ----------
    runs
        Directories of runs: one to rewrite its report.html, several to compare them.
    out
        File for the comparison.
    """
    written = write_report(runs[0], moments_for_report(runs[0])) if len(runs) == 1 else write_comparison(runs, out)
    results.print(f"report: {written.resolve()}")
