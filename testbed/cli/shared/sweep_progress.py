# SPDX-License-Identifier: MIT
"""Progress display of a sweep: jobs done and failed, time left until the report is there, medians so far."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import timedelta
from statistics import median
from typing import Any

from rich.console import Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from eval.sweep.measure import Measure
from testbed.cli.shared.console import console
from testbed.sweep.execution.local_pool import Event, Finished, Started
from testbed.sweep.forecast import REPORT_SECONDS
from testbed.sweep.result import CellResult
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.plan import Costs

REPORT_EVERY = 0.1
"""Without a terminal a line is printed each time this share of the work is done."""
MAX_SHOWN_PLACES = 12
"""The live table of medians has at most this many rows."""


class SweepProgress:
    """A live table. Implements `testbed.sweep.execute.Watcher`."""

    def __init__(self, cells: Sequence[Cell], costs: Costs, measure: Measure, *, worst: bool) -> None:
        """worst: whether runs that failed are repeated at the end, which takes time too."""
        self._costs, self._count = costs, len(cells)
        self._work = sum(map(costs, cells))
        self._worked = 0.0
        self._done = self._failed = self._bad = 0
        self._running: dict[str, tuple[Cell, float]] = {}
        self._started = time.monotonic()
        self._reported = 0.0
        self._measure, self._worst = measure, worst
        self._errors: dict[tuple[str, str], dict[int, list[float]]] = {}

    def event(self, event: Event) -> None:
        """A cell was started, or is finished and on disk."""
        if isinstance(event, Started):
            self._running[event.cell.key] = (event.cell, time.monotonic())
            return
        self._running.pop(event.cell.key, None)
        self._worked += self._costs(event.cell)
        self._done += 1
        if isinstance(event, Finished):
            self._note(event.cell, event.outcome)
        if not console.is_terminal and self._worked >= (self._reported + REPORT_EVERY) * self._work:
            self._reported = self._worked / self._work
            console.print(self._line())
            if self._errors:
                console.print(self.medians())

    def medians(self) -> Table:
        """Median of the measure so far, by world and particle count."""
        unit = self._measure.unit(0.0)
        counts = sorted({count for groups in self._errors.values() for count in groups})
        words = f"{self._measure.words} so far, {unit.name}".removesuffix(", ")
        table = Table(words, *map(str, counts), box=None, pad_edge=False)
        for (place, line), groups in list(self._errors.items())[:MAX_SHOWN_PLACES]:
            name = place if line == "default" else f"{place}, {line}"
            table.add_row(name, *(unit.text(median(groups[c])) if c in groups else "–" for c in counts))
        return table

    def _note(self, cell: Cell, outcome: CellResult | str) -> None:
        if isinstance(outcome, str):
            self._failed += 1
            console.print(f"failed: {cell}: {outcome}", soft_wrap=True, markup=False)
            return
        self._bad += _value(outcome.metrics, self._measure.outcome) in ("lost", "broken loop", "collided", "timeout")
        error = _value(outcome.metrics, self._measure.key)
        if isinstance(error, int | float):
            self._errors.setdefault((cell.place, cell.line), {}).setdefault(cell.particles, []).append(float(error))

    def _line(self) -> str:
        elapsed = max(time.monotonic() - self._started, 1e-9)
        left = f", {timedelta(seconds=round(self._seconds_left(elapsed)))} left" if self._worked else ""
        bad = f", {self._bad} of them ended lost or broken" if self._bad else ""
        failed = f", {self._failed} without a result" if self._failed else ""
        return f"{self._done} of {self._count} jobs{left} (with report{' and worst runs' * self._worst}){bad}{failed}"

    def _seconds_left(self, elapsed: float) -> float:
        """Time until the report is there [s]: remaining jobs, runs that will be repeated, report."""
        per_work = elapsed / self._worked
        repeated = min(self._bad, 2) * 2.0 * elapsed / self._done if self._worst and self._done else 0.0
        return per_work * (self._work - self._worked) + repeated + REPORT_SECONDS

    def __rich__(self) -> Group:
        bar = Table.grid()
        bar.add_row(ProgressBar(self._work, self._worked, width=60))
        cells = Table.grid(padding=(0, 2))
        for cell, since in list(self._running.values()):
            cells.add_row(Text(str(cell)), f"{time.monotonic() - since:.0f} s", style="dim")
        if not self._errors:
            return Group(self._line(), bar, cells)
        return Group(self._line(), bar, cells, self.medians())


def _value(metrics: Mapping[str, Any], key: str) -> Any:
    """A value in nested tables by its dotted key; None if it is missing."""
    value: Any = metrics
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


@contextmanager
def sweep_progress(cells: Sequence[Cell], costs: Costs, measure: Measure, *, worst: bool) -> Iterator[SweepProgress]:
    """Show a live table while the block runs; if stderr is no terminal, print a line from time to time."""
    progress = SweepProgress(cells, costs, measure, worst=worst)
    if not console.is_terminal:
        yield progress
        return
    with Live(progress, console=console, transient=True, refresh_per_second=2):
        yield progress
