# SPDX-License-Identifier: MIT
"""`testbed report`."""

from __future__ import annotations

from pathlib import Path

from eval.files.atomic_write import discard_unfinished
from eval.report.comparison import write_comparison
from eval.report.run_report import write_report
from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import console, results
from testbed.views import moments_for_report


def report(runs: list[Path], /, *, out: Path = Path("comparison.html")) -> None:
    """Rewrite the report of a run from its files, or compare several runs side by side.

    A run that was killed while its report was written has none; it is made now, also where several are compared.

    Parameters
    ----------
    runs
        Directories of runs: one to rewrite its report.html, several to compare them.
    out
        File for the comparison.
    """
    AT_WORK.now_doing("writing the report")
    for run in runs:
        discard_unfinished(run / "report.html")
        if (run / "metrics.json").is_file() and not (run / "report.html").is_file():
            write_report(run, moments_for_report(run))
            console.print(f"note: {run} had no report, as after a run that ended early; it is made now", soft_wrap=True)
    written = write_report(runs[0], moments_for_report(runs[0])) if len(runs) == 1 else write_comparison(runs, out)
    results.print(f"report: {written.resolve()}")
