# SPDX-License-Identifier: MIT
"""`testbed inspect`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import results
from testbed.inspect import AS_STATED, Finding, Reading, inspect_log

COLOURS = {"ok": "green", "mended": "yellow", "left out": "dim", "doubtful": "red"}
WIDTH = 220
"""Characters in a line where the output is no terminal."""


def inspect(
    log: Path,
    *,
    as_json: Annotated[bool, Parameter(name="--json", negative=())] = False,
    reading: Annotated[Reading, Parameter(name="*")] = AS_STATED,
) -> None:
    """Report what a recorded log contains, what in it looks wrong, and what the reader does about it.

    Parameters
    ----------
    log
        Recorded log: CARMEN (plain or gzip), ROS 1 or ROS 2 bag, or dataset directory.
    as_json
        Print the findings as JSON: a list of item, found, verdict and action.
    """
    with AT_WORK.doing(f"reading {log}"):
        recording = reading.open(log, scans_needed=False)
    with AT_WORK.doing(f"inspecting {log}"):
        findings = inspect_log(recording)
    if as_json:
        results.print(json.dumps([finding._asdict() for finding in findings], indent=2), markup=False)
        return
    wide = results if results.is_terminal else Console(width=WIDTH, highlight=False)
    wide.print(_table(findings))
    counts = {verdict: sum(f.verdict == verdict for f in findings) for verdict in COLOURS}
    results.print(f"{log}: {', '.join(f'{count} {verdict}' for verdict, count in counts.items() if count)}")


def _table(findings: list[Finding]) -> object:
    from rich.markup import escape
    from rich.table import Table

    table = Table("item", "found", "verdict", "what is done about it", box=None, padding=(0, 2, 0, 0))
    for finding in findings:
        colour = COLOURS[finding.verdict]
        table.add_row(
            escape(finding.item), escape(finding.found), f"[{colour}]{finding.verdict}[/]", escape(finding.action)
        )
    return table
