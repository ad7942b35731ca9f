# SPDX-License-Identifier: MIT
"""Figures of each group of a sweep: a group is all seeds of one place, line and particle count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from eval.sweep.decision import Decision, decide, decide_kind_of_building
from eval.sweep.measure import Unit
from eval.sweep.results import SweepTable
from eval.sweep.statistics import (
    Interval,
    bootstrap_interval,
    min_values,
    minimum_detectable_effect,
    paired_difference,
    wilson_interval,
)

MAX_WORST_PER_LINE = 2
"""Worst runs that are listed per line."""
UNUSUAL = 3.0
"""A run whose error is this many times the median of its group is worth a look."""
MAX_WORST = 8
"""Worst runs that are listed in all."""


@dataclass(frozen=True)
class Group:
    """Figures over the seeds; errors have the unit of the sweep's measure."""

    place: str
    line: str
    count: int
    """Particles."""
    runs: int
    """Number of computed cells."""
    failures: int
    """Number of failed runs."""
    failure_interval: tuple[float, float]
    """Wilson interval of the failure rate, in [0, 1]."""
    median: Interval
    mean: Interval
    refined: Interval
    """Median error after the final pass, of the runs that have one."""
    to_baseline: Interval | None
    """Median paired difference to the baseline line with the same count; None for the baseline itself."""
    to_largest: Interval | None
    """Median paired difference to the largest count of the same line; None for the largest itself."""
    detectable: float
    """Smallest difference to the baseline (for the baseline: to the largest count) that the seeds show; NaN without
    such a comparison."""
    cost: float
    """Median time of the filter per update, all particles [ms]; NaN if unknown."""
    inside_share: float
    """Median share of updates with the truth inside the filter's 95 % ellipsoid; NaN if unknown."""
    median_nees: float
    """Median over the runs of their mean NEES; 3 if the covariance is right."""


@dataclass(frozen=True, eq=False)
class SweepSummary:
    """All groups, in the order of the table's axes."""

    table: SweepTable
    groups: tuple[Group, ...]

    def group(self, place: str, line: str, count: int) -> Group:
        """The group of a place, line and particle count."""
        t = self.table
        flat = (t.places.index(place) * len(t.lines) + t.lines.index(line)) * len(t.counts) + t.counts.index(count)
        return self.groups[flat]

    @lru_cache(maxsize=4096)  # noqa: B019  # a process holds few summaries, and asks each for the same answers often
    def decision(self, place: str, line: str) -> Decision:
        """Which particle count is enough in one world, see `eval.sweep.decision.decide`."""
        t = self.table
        p, k = t.places.index(place), t.lines.index(line)
        return decide(t.counts, t.error[p, k], t.failures[p, k], margin=t.margin, level=t.level, looks=t.looks)

    @lru_cache(maxsize=512)  # noqa: B019
    def decision_of_family(self, family: str, line: str) -> Decision:
        """Which particle count is enough in a kind of building, with the world as the unit."""
        t = self.table
        worlds, k = [p for p, name in enumerate(t.families) if name == family], t.lines.index(line)
        return decide_kind_of_building(
            t.counts, t.error[worlds, k], t.failures[worlds, k], margin=t.margin, level=t.level, looks=t.looks
        )

    def never_resampled(self, places: Sequence[str], line: str) -> tuple[int, int]:
        """Of the runs with the largest count in these places: how many never resampled, of how many one knows."""
        t = self.table
        rows = [t.places.index(place) for place in places]
        known = t.cube("filter.resamplings")[rows, t.lines.index(line), -1]
        known = known[np.isfinite(known)]
        return int((known == 0.0).sum()), len(known)

    @property
    def has_intervals(self) -> bool:
        """Whether any world has enough runs, or any kind of building enough worlds, for an interval."""
        table = self.table
        worlds = [sum(name == family for name in table.families) for family in table.family_names()]
        return any(group.median.count >= min_values() for group in self.groups) or (
            bool(table.ran.any()) and max(worlds, default=0) >= min_values()
        )

    @property
    def unit(self) -> Unit:
        """The unit of figures and tables, which fits the errors of the baseline."""
        medians = [group.median.value for group in self.groups if group.line == self.table.baseline]
        known = [value for value in medians if np.isfinite(value)]
        return self.table.measure.unit(max(known, default=0.0))


@dataclass(frozen=True)
class WorstRun:
    """One of the runs with the largest errors of its line."""

    place: str
    line: str
    count: int
    seed: int
    error: float
    """Error in the unit of the measure."""
    outcome: str
    key: str
    """Key of the cell."""
    is_unusual: bool
    """Whether it failed, or its error is at least `UNUSUAL` times the median of its group."""


def worst_runs(table: SweepTable) -> list[WorstRun]:
    """Runs with the largest errors: per line `MAX_WORST_PER_LINE`, one per place; at most `MAX_WORST` in all."""
    found: list[WorstRun] = []
    for k, line in enumerate(table.lines):
        error = np.where(np.isfinite(table.error[:, k]), table.error[:, k], -np.inf)
        worst = [(p, *divmod(int(np.argmax(error[p])), len(table.seeds))) for p in range(len(table.places))]
        ranked = sorted((w for w in worst if np.isfinite(error[w])), key=lambda w: -float(error[w]))
        for p, c, s in ranked[:MAX_WORST_PER_LINE]:
            outcome, key = (table.columns[name][p, k, c, s] for name in (table.measure.outcome, "key"))
            where = table.places[p], line, table.counts[c], table.seeds[s]
            typical = _median(table.error[p, k, c])
            unusual = bool(table.failed[p, k, c, s]) or float(error[p, c, s]) >= UNUSUAL * typical
            found.append(WorstRun(*where, float(error[p, c, s]), str(outcome), str(key), unusual))
    return found[:MAX_WORST]


def summarise(table: SweepTable) -> SweepSummary:
    """Compute the figures of all groups."""
    return SweepSummary(table, tuple(_group(table, *index) for index in np.ndindex(*table.shape[:3])))


def _group(table: SweepTable, p: int, k: int, c: int) -> Group:
    error, base = table.error, table.lines.index(table.baseline)
    runs, failures = int(table.ran[p, k, c].sum()), int(table.failed[p, k, c].sum())
    own, level = error[p, k, c], table.level
    to_baseline = paired_difference(own, error[p, base, c], level=level) if k != base else None
    to_largest = paired_difference(own, error[p, k, -1], level=level) if c != len(table.counts) - 1 else None
    compared = to_baseline or to_largest
    milliseconds = 1e3 * table.cube("filter_s")[p, k, c] / table.cube("filter.updates")[p, k, c]
    return Group(
        place=table.places[p],
        line=table.lines[k],
        count=table.counts[c],
        runs=runs,
        failures=failures,
        failure_interval=wilson_interval(failures, runs),
        median=bootstrap_interval(error[p, k, c], np.median),
        mean=bootstrap_interval(error[p, k, c], np.mean),
        refined=bootstrap_interval(table.refined[p, k, c], np.median),
        to_baseline=to_baseline,
        to_largest=to_largest,
        detectable=np.nan if compared is None else minimum_detectable_effect(compared, level=level),
        cost=_median(milliseconds),
        inside_share=_median(table.cube("filter.consistency.inside_share")[p, k, c]),
        median_nees=_median(table.cube("filter.consistency.nees_mean")[p, k, c]),
    )


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan
