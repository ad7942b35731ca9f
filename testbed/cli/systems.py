# SPDX-License-Identifier: MIT
"""`testbed systems`."""

from __future__ import annotations

from typing import Annotated

from cyclopts import App, Parameter
from rich.table import Table

from testbed.cli.shared.console import announce_compilation, results
from testbed.cli.shared.status import GATE_FAILED
from testbed.systems.check import check_system
from testbed.systems.entrant import PythonSystem
from testbed.systems.finding import listed

app = App(name="systems", help="List SLAM systems, and check one.", help_epilogue="")


@app.command(name="list")
def list_systems() -> None:
    """List the systems that --system of run, slam and sweep can name.

    Other packages announce theirs by entry points of the group `slam_testbed.systems`.

    Example: `testbed systems list`
    """
    table = Table(box=None, pad_edge=False)
    for heading in ("system", "what it is", "to install"):
        table.add_column(heading, no_wrap=heading != "what it is")
    for system in listed():
        table.add_row(system.name, system.summary, system.missing.replace("[", r"\["))
    results.print(table)


@app.command
def check(
    system: str, /, *, system_set: Annotated[tuple[str, ...], Parameter(name="--set", show_default=False)] = ()
) -> int:
    """Try a system on a short drive: shapes, order, the same bits for the same seed, and bad input.

    An error breaks the protocol (exit status 1); a warning will go wrong on some recordings.

    Example: `testbed systems check odometry`

    Parameters
    ----------
    system
        A name (`testbed systems list`) or FILE.py:CLASS.
    system_set
        FIELD=VALUE: a setting of the system. May be repeated.
    """
    values = {}
    for text in system_set:
        key, equals, value = text.partition("=")
        if not equals:
            raise ValueError(f"--set {text}: expected FIELD=VALUE")
        values[key.strip()] = value.strip()
    announce_compilation()
    errors = warnings = 0
    for finding in check_system(PythonSystem(system, values)):
        errors += finding.level == "error"
        warnings += finding.level == "warning"
        results.print(f"{finding.level:<8}{finding.text}", markup=False)
    results.print(f"{errors} errors, {warnings} warnings")
    return GATE_FAILED if errors else 0
