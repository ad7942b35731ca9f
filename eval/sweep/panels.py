# SPDX-License-Identifier: MIT
"""What the panels of the figures show: one world, or one kind of building with its worlds as the unit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eval.sweep.answers import Answer, answer_of_family, answer_of_place
from eval.sweep.decision import Decision, median_over_last
from eval.sweep.summary import SweepSummary


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """The runs of one panel. A unit is a seed, or for a kind of building a world with the median of its seeds."""

    answer: Answer
    """The answer for the baseline."""
    rows: tuple[int, ...]
    """The places of the table that belong to it."""
    decisions: tuple[Decision, ...]
    """Decision for each line."""
    enough: tuple[str, ...]
    """Short answer for each line: `5`, `more than 15`, `undecided`."""
    error: NDArray[np.float64]
    """Measure of each unit, (lines, counts, units)."""
    refined: NDArray[np.float64]
    """The measure after the final pass, (lines, counts, units); NaN for counts that not all units have one of."""
    failed: NDArray[np.intp]
    """Number of failed runs, (lines, counts)."""
    runs: NDArray[np.intp]
    """Number of computed runs, (lines, counts)."""
    cost: NDArray[np.float64]
    """Median time of the filter per update [ms], (lines, counts)."""
    inside: NDArray[np.float64]
    """Share of updates with the truth inside the filter's 95 % ellipsoid, (lines, counts, units)."""

    @property
    def units(self) -> NDArray[np.intp]:
        """Number of units that the medians and intervals rest on, (lines, counts)."""
        if len(self.rows) == 1:
            return self.runs
        found: NDArray[np.intp] = np.isfinite(self.error).sum(axis=-1)
        return found


@lru_cache(maxsize=4)
def panels(summary: SweepSummary) -> tuple[Panel, ...]:
    """One panel per kind of building, then one per world that is no sample of a kind; kept for the next figure."""
    table = summary.table
    families = table.family_names()
    found = []
    for family in families:
        rows = tuple(p for p, name in enumerate(table.families) if name == family)
        decisions = tuple(summary.decision_of_family(family, line) for line in table.lines)
        found.append(_panel(summary, rows, [answer_of_family(summary, family, k) for k in table.lines], decisions))
    for p, place in enumerate(table.places):
        if table.families[p] not in families:
            decisions = tuple(summary.decision(place, line) for line in table.lines)
            found.append(_panel(summary, (p,), [answer_of_place(summary, place, k) for k in table.lines], decisions))
    return tuple(found)


def _panel(
    summary: SweepSummary, rows: tuple[int, ...], answers: list[Answer], decisions: tuple[Decision, ...]
) -> Panel:
    table = summary.table

    def units(cube: NDArray[np.float64]) -> NDArray[np.float64]:
        if len(rows) == 1:
            return np.asarray(cube[rows[0]])
        return np.moveaxis(median_over_last(cube[list(rows)]), 0, -1)

    cost = 1e3 * table.cube("filter_s") / table.cube("filter.updates")
    error, refined = units(table.error), units(table.refined)
    is_whole = np.isfinite(refined).sum(axis=-1) == np.isfinite(error).sum(axis=-1)
    refined = np.where(is_whole[..., None], refined, np.nan)  # other seeds are other drives: no line through both
    return Panel(
        answer=answers[table.lines.index(table.baseline)],
        rows=rows,
        decisions=decisions,
        enough=tuple(answer.short for answer in answers),
        error=error,
        refined=refined,
        failed=table.failed[list(rows)].sum(axis=(0, 3)),
        runs=table.ran[list(rows)].sum(axis=(0, 3)),
        cost=median_over_last(units(cost)),
        inside=units(table.cube("filter.consistency.inside_share")),
    )
