# SPDX-License-Identifier: MIT
"""Progress display of a sweep: jobs done, rate, time left, what is being computed, what failed."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta

from rich.console import Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from testbed.cli.shared.console import console
from testbed.sweep.execution.local_pool import Event, Finished, Started
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.plan import Costs

REPORT_EVERY = 0.1
"""Without a terminal a line is printed each time this share of the work is done."""


class SweepProgress:
    """A live table. Implements `testbed.sweep.execute.Watcher`."""

    def __init__(self, cells: Sequence[Cell], costs: Costs) -> None:
        self._costs, self._count = costs, len(cells)
        self._work = sum(map(costs, cells))
        self._worked = 0.0
        self._done = self._failed = 0
        self._running: dict[str, tuple[Cell, float]] = {}
        self._started = time.monotonic()
        self._reported = 0.0

    def event(self, event: Event) -> None:
        """A cell was started, or is finished and on disk."""
        if isinstance(event, Started):
            self._running[event.cell.key] = (event.cell, time.monotonic())
            return
        self._running.pop(event.cell.key, None)
        self._worked += self._costs(event.cell)
        self._done += 1
        if isinstance(event, Finished) and isinstance(event.outcome, str):
            self._failed += 1
            console.print(f"failed: {event.cell}: {event.outcome}", soft_wrap=True, markup=False)
        if not console.is_terminal and self._worked >= (self._reported + REPORT_EVERY) * self._work:
            self._reported = self._worked / self._work
            console.print(self._line())

    def _line(self) -> str:
        elapsed = max(time.monotonic() - self._started, 1e-9)
        rate = 60.0 * self._done / elapsed
        remaining = elapsed * (self._work - self._worked) / self._worked if self._worked else None
        left = "" if remaining is None else f", {timedelta(seconds=round(remaining))} left"
        failed = f", {self._failed} failed" if self._failed else ""
        return f"{self._done} of {self._count} jobs, {rate:.1f} a minute{left}{failed}"

    def __rich__(self) -> Group:
        bar = Table.grid()
        bar.add_row(ProgressBar(self._work, self._worked, width=60))
        cells = Table.grid(padding=(0, 2))
        for cell, since in list(self._running.values()):
            cells.add_row(Text(str(cell)), f"{time.monotonic() - since:.0f} s", style="dim")
        return Group(self._line(), bar, cells)


@contextmanager
def sweep_progress(cells: Sequence[Cell], costs: Costs) -> Iterator[SweepProgress]:
    """Show a live table while the block runs; if stderr is no terminal, print a line from time to time."""
    progress = SweepProgress(cells, costs)
    if not console.is_terminal:
        yield progress
        return
    with Live(progress, console=console, transient=True, refresh_per_second=2):
        yield progress
