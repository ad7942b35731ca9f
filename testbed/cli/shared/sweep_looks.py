# SPDX-License-Identifier: MIT
"""What `testbed sweep --until decided` says after each look at the results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from eval.sweep.report import write_sweep_report
from testbed.cli.shared.console import console
from testbed.cli.shared.sweep_answers import say_answers
from testbed.sweep.gather import gather
from testbed.sweep.looks import statuses
from testbed.sweep.spec.cell import Cell
from testbed.sweep.store import SweepDirectory

MAX_PLACES = 4
"""The time of each world is said for at most so many."""
Duration = Callable[[Sequence[Cell]], str]
"""How long jobs take, in words; empty if it is unknown."""


def say_look(
    directory: SweepDirectory, next_look: int, cells: Sequence[Cell], rest: Sequence[Cell], duration: Duration
) -> None:
    """Write the page and print what this look has shown, a line for each world, and what comes next.

    next_look: seeds then; cells: the jobs up to it; rest: all jobs that are left if no answer is found before.
    """
    gather(directory, statuses(directory))
    page = write_sweep_report(directory.path).resolve()
    console.print(f"Looked at the results; the page is written: {page}", soft_wrap=True, markup=False)
    say_answers(directory.path, partial(console.print, soft_wrap=True, markup=False))
    soon, most = duration(cells), duration(rest)
    places = list(dict.fromkeys(cell.place for cell in cells))
    each = ", ".join(f"{place} {duration([cell for cell in cells if cell.place == place])}" for place in places)
    each = f" ({each})" if 1 < len(places) <= MAX_PLACES else ""
    soon, most = f", in about {soon}{each}" if soon else "", f" and about {most}" if most else ""
    console.print(
        f"Next look with {next_look} seeds, {len(cells)} jobs{soon}; at most {len(rest)} jobs{most} in all. "
        "Ctrl-C ends the sweep here, keeps the page, and says how to go on without worlds that will stay open.",
        soft_wrap=True,
    )
