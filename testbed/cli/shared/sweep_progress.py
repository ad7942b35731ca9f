# SPDX-License-Identifier: MIT
"""Progress display of a sweep: jobs done and failed, time left, medians so far."""

from __future__ import annotations

import time
from collections.abc import Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
from rich.console import Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from eval.sweep.job_times import REPORT_SECONDS, duration_words
from eval.sweep.margin import Margin, share_words
from eval.sweep.measure import Measure, Unit
from eval.sweep.results import SweepTable
from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import console
from testbed.cli.shared.time_left import TimeLeft
from testbed.sweep.execution.local_pool import Event, Finished, Started
from testbed.sweep.result import CellResult
from testbed.sweep.spec.cell import Cell

REPORT_EVERY = 0.1
"""Without a terminal a line is printed each time this share of the work is done."""
MEDIANS_EVERY = 0.25
"""Without a terminal the medians are printed each time a further part of this size is done."""
SIZE_SEEDS = 2
"""After so many seeds of a world it is said which share of its error the margin is."""
MAX_SHOWN_PLACES = 12
"""The live table of medians has at most this many rows."""


@dataclass(frozen=True)
class Stage:
    """What is computed until the display ends."""

    goal: str
    """What follows: `to the look with 9 seeds`; empty for the end of the sweep."""
    worst: bool
    """Whether runs that failed are repeated then, which takes time too."""
    groups: tuple[tuple[str, str], ...] = ()
    """Places and lines in the order of the tables, in which the medians are shown too."""
    margin: Margin | None = None
    """Up to which a larger error counts as equal, where particle counts are compared."""


class SweepProgress:
    """A live table. Implements `testbed.sweep.execute.Watcher`."""

    def __init__(self, cells: Sequence[Cell], left: TimeLeft, measure: Measure, stage: Stage) -> None:
        self._left, self._count, self._stage = left, len(cells), stage
        self._done = self._failed = self._bad = 0
        self._begun = time.perf_counter()
        self._running: dict[str, tuple[Cell, float]] = {}
        self._reported = 0.0
        self._measure = measure
        self._errors: dict[tuple[str, str], dict[int, dict[int, float]]] = {}
        self._counts = {cell.particles for cell in cells}
        self._sized: set[tuple[str, str]] = set()
        self._computed = {(cell.place, cell.line) for cell in cells}

    def note_table(self, table: SweepTable) -> None:
        """Count the runs that were there before among the medians."""
        self._counts |= set(table.counts)
        for p, k, c, number in np.argwhere(np.isfinite(table.error)):
            group = self._errors.setdefault((table.places[p], table.lines[k]), {})
            group.setdefault(table.counts[c], {})[table.seeds[number]] = float(table.error[p, k, c, number])
        counts = sorted(self._counts)
        self._sized = {
            name for name, group in self._errors.items() if len(_complete_seeds(group, counts)) >= SIZE_SEEDS
        }

    def begin(self) -> None:
        """Say where no live table is shown that the jobs begin, and how long they will take."""
        if not console.is_terminal:
            console.print(
                f"{self._line()}; the longest jobs of a seed come first, so the first takes longest", soft_wrap=True
            )

    def event(self, event: Event) -> None:
        """A cell was started, or is finished and on disk."""
        self._left.event(event)
        if isinstance(event, Started):
            self._running[event.cell.key] = (event.cell, time.monotonic())
            return
        self._running.pop(event.cell.key, None)
        self._done += 1
        if isinstance(event, Finished):
            self._note(event.cell, event.outcome)
        AT_WORK.now_doing(self._line(), self._begun)  # of the whole, as the time left is
        if not console.is_terminal and self._left.share >= self._reported + REPORT_EVERY:
            passed = int(self._left.share / MEDIANS_EVERY) > int(self._reported / MEDIANS_EVERY)
            self._reported = self._left.share
            console.print(self._line(), soft_wrap=True)
            if passed and self._left.share < 1.0 and self._errors:
                for line in self.median_lines():
                    console.print(line, soft_wrap=True, markup=False)

    def medians(self) -> Table:
        """Median of the measure so far, by world and particle count, over the seeds that have all counts."""
        counts = sorted(self._counts)
        table = Table("", *map(str, counts), box=None, pad_edge=False)
        for name, groups in self._named_errors():
            seeds = _complete_seeds(groups, counts)
            table.add_row(name, *(_median_text(self._measure.unit(0.0), groups.get(c, {}), seeds) for c in counts))
        return table

    def median_lines(self) -> list[str]:
        """The same as one line per world that is computed and has a complete seed, for a log; empty where none is."""
        unit = self._measure.unit(0.0)
        counts, lines = sorted(self._counts), []
        for name, groups in self._named_errors(self._computed):
            seeds = _complete_seeds(groups, counts)
            if not seeds:
                continue
            texts = [f"{_median_text(unit, groups.get(count, {}), seeds)} with {count}" for count in counts]
            lines.append(f"  {name}: {', '.join(texts)}")
        return [f"{self._median_of} so far:", *lines] if lines else []

    @property
    def _median_of(self) -> str:
        """What the medians are of: `median trajectory error of the filter, cm (seeds)`."""
        of = f" of the {self._measure.estimate}" if self._measure.estimate != "final" else ""
        return f"median {self._measure.words}{of}, {self._measure.unit(0.0).name}".removesuffix(", ") + " (seeds)"

    def _named_errors(
        self, shown: Container[tuple[str, str]] | None = None
    ) -> list[tuple[str, dict[int, dict[int, float]]]]:
        """Name and errors of the places and lines that are shown, default: all."""
        order = {group: number for number, group in enumerate(self._stage.groups)}

        def rank(group: tuple[str, str]) -> tuple[int, tuple[str, str]]:
            return order.get(group, len(order)), group

        return [
            (place if line == "default" else f"{place}, {line}", groups)
            for (place, line), groups in sorted(self._errors.items(), key=lambda item: rank(item[0]))[:MAX_SHOWN_PLACES]
            if shown is None or (place, line) in shown
        ]

    def _note(self, cell: Cell, outcome: CellResult | str) -> None:
        if isinstance(outcome, str):
            self._failed += 1
            console.print(f"failed: {cell}: {outcome}", soft_wrap=True, markup=False)
            return
        self._bad += _value(outcome.metrics, self._measure.outcome) in ("lost", "broken loop", "collided", "timeout")
        error = _value(outcome.metrics, self._measure.key)
        if isinstance(error, int | float):
            group = self._errors.setdefault((cell.place, cell.line), {})
            group.setdefault(cell.particles, {})[cell.seed] = float(error)  # a run that is repeated counts once
            self._say_size((cell.place, cell.line))

    def _say_size(self, group: tuple[str, str]) -> None:
        """Say which share of the error the margin is, once a world has enough seeds to tell how large that is.

        The error of the largest count alone says it: by the differences to it nobody may choose a margin.
        """
        errors, largest = self._errors[group], max(self._counts)
        seeds = _complete_seeds(errors, sorted(self._counts))
        if self._stage.margin is None or len(seeds) != SIZE_SEEDS or group in self._sized:
            return
        self._sized.add(group)
        error = median(value for seed, value in errors[largest].items() if seed in seeds)
        unit, margin = self._measure.unit(error), self._stage.margin.of(error)
        size, limit = (f"{unit.factor * value:.2g} {unit.name}".rstrip() for value in (error, margin))
        name = group[0] if group[1] == "default" else ", ".join(group)
        console.print(
            f"margin: {name}: the error with {largest} is about {size} in "
            f"the first {SIZE_SEEDS} seeds, of which the margin of {limit} is {share_words(margin, error)}. If that is "
            "too much or too little, end this sweep now (Ctrl-C) and begin another with --margin and a new --out",
            soft_wrap=True,
            markup=False,
        )

    def _line(self) -> str:
        extra = REPORT_SECONDS
        if self._stage.worst:
            extra += 2.0 * min(self._bad, 2) * self._left.seconds_per_job
        seconds = self._left.seconds(extra)
        left = "" if seconds is None else f", about {duration_words(seconds)} left"
        closing = f"with report{' and worst runs' * (self._stage.worst and self._bad > 0)}"
        goal = f" {self._stage.goal}" if self._stage.goal else ""
        closing = "" if self._stage.goal or not left else f" ({closing})"
        bad = f", {self._bad} of them ended lost or broken" if self._bad else ""
        failed = f", {self._failed} without a result" if self._failed else ""
        return f"{self._done} of {self._count} jobs{goal}{left}{closing}{bad}{failed}"

    def __rich__(self) -> Group:
        bar = Table.grid()
        bar.add_row(ProgressBar(1.0, self._left.share_with_running, width=60))
        cells = Table.grid(padding=(0, 2))
        for cell, since in list(self._running.values()):
            cells.add_row(Text(str(cell)), f"{time.monotonic() - since:.0f} s", style="dim")
        if not self._errors:
            return Group(self._line(), bar, cells)
        # what the medians are of stands above: in the table it would take the width of the columns
        return Group(self._line(), bar, cells, Text(self._median_of), self.medians())


def _complete_seeds(groups: Mapping[int, Mapping[int, float]], counts: Sequence[int]) -> set[int]:
    """Seeds that have a result with every count: medians over other seeds would compare different drives."""
    return set.intersection(*(set(groups.get(count, {})) for count in counts)) if counts else set()


def _median_text(unit: Unit, errors: Mapping[int, float], seeds: set[int]) -> str:
    """`1.7 (3)`: the median over these seeds and how many they are."""
    values = [error for seed, error in errors.items() if seed in seeds]
    return f"{unit.text(median(values))} ({len(values)})" if values else "–"


def _value(metrics: Mapping[str, Any], key: str) -> Any:
    """A value in nested tables by its dotted key; None if it is missing."""
    value: Any = metrics
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


@contextmanager
def sweep_progress(progress: SweepProgress) -> Iterator[SweepProgress]:
    """Show a live table while the block runs; if stderr is no terminal, print a line from time to time."""
    progress.begin()
    if not console.is_terminal:
        yield progress
        return
    with Live(progress, console=console, transient=True, refresh_per_second=2):
        yield progress
