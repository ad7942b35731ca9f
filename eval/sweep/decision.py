# SPDX-License-Identifier: MIT
"""The answer of a sweep for one world or one kind of building: which particle count is enough, or why none is known."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from eval.sweep.margin import MARGIN, Margin
from eval.sweep.outlook import Outlook, outlook_of
from eval.sweep.statistics import LEVEL, Interval, min_values, paired_difference

State = Literal["good", "worse", "open"]
"""A count compared with the largest one: not worse by more than the margin, worse by more, or not known."""
Kind = Literal["enough", "more", "fails", "undecided"]


@dataclass(frozen=True)
class Decision:
    """What the runs say about the particle count."""

    kind: Kind
    """enough: `count` is; more: `count` is shown to be too few, and only the largest count was above it; fails: even
    the largest count fails in most runs; undecided: the differences are too uncertain."""
    count: int | None
    """The count that `kind` is about; None if undecided."""
    states: tuple[State, ...]
    """Verdict on each count below the largest, in their order."""
    units: int
    """Independent runs with a result: seeds, or worlds for a kind of building; of an open answer, those that compare
    the open count with the largest."""
    limit: float
    """How much larger an error may be than that of the largest count, in the unit of the measure; NaN if unknown."""
    differences: tuple[Interval, ...]
    """Median paired difference of each count below the largest to it, with the interval that decides."""
    outlook: Outlook | None
    """What it would take to decide the largest open count; None if none is open, or if that cannot be said."""

    @property
    def largest_open(self) -> int | None:
        """Index of the largest count whose verdict is open; None if there is none."""
        return next((c for c in reversed(range(len(self.states))) if self.states[c] == "open"), None)


def decide(
    counts: tuple[int, ...],
    errors: NDArray[np.float64],
    failures: NDArray[np.float64],
    *,
    margin: Margin = MARGIN,
    level: float = LEVEL,
) -> Decision:
    """Decide which particle count is enough.

    counts ascending; errors (counts, units) in metres or the unit of the measure, smaller is better, NaN = no result;
    failures (counts, units), 1 = failed, 0 = not, NaN = not run; a unit is a seed. Rule: a count is enough if it, and
    every tested count above it, is worse than the largest tested count by less than the margin with confidence
    `level` (median paired difference), and fails no more often. This is a test of non-inferiority: few seeds give wide
    intervals and no answer, fewer than `min_values(level)` none at all. Nothing is said about the largest count itself,
    since no larger one was tested.
    """
    differences = errors[:-1] - errors[-1]
    return decide_by_differences(counts, differences, errors[-1], failures, margin=margin, level=level)


def decide_kind_of_building(
    counts: tuple[int, ...],
    errors: NDArray[np.float64],
    failures: NDArray[np.float64],
    *,
    margin: Margin = MARGIN,
    level: float = LEVEL,
) -> Decision:
    """Decide which count is enough for a kind of building, with the world as the unit.

    errors and failures (worlds, counts, seeds). Each world counts once, with the median of its seeds: runs of one world
    are alike, and taking them for independent ones would make the intervals too narrow (cluster bootstrap over worlds;
    Davison, Hinkley, "Bootstrap Methods and their Application", 1997, section 3.8).
    """
    differences = median_over_last(errors[:, :-1] - errors[:, -1:]).T
    largest, rate = median_over_last(errors[:, -1]), _mean_over_last(failures).T
    return decide_by_differences(counts, differences, largest, rate, margin=margin, level=level)


def decide_by_differences(
    counts: tuple[int, ...],
    differences: NDArray[np.float64],
    largest: NDArray[np.float64],
    failures: NDArray[np.float64],
    *,
    margin: Margin,
    level: float,
) -> Decision:
    """`decide` from differences (counts - 1, units) to the errors `largest` (units,) of the largest count."""
    known = largest[np.isfinite(largest)]
    limit = margin.of(float(np.median(known))) if len(known) else math.nan
    intervals = [paired_difference(row, np.zeros_like(row), level=level) for row in differences]
    states = tuple(_state(interval, limit, failures[c], failures[-1], level) for c, interval in enumerate(intervals))
    kind, count = _answer(counts, states, failures[-1])
    decision = Decision(kind, count, states, len(known), limit, tuple(intervals), None)
    c = decision.largest_open
    units = len(known) if kind != "undecided" or c is None else intervals[c].count
    return replace(decision, units=units, outlook=_outlook(decision, level))


def _outlook(decision: Decision, level: float) -> Outlook | None:
    """The outlook of the largest open count; none where not the error but more failures keep it open."""
    c = decision.largest_open
    if c is None:
        return None
    difference = decision.differences[c]
    is_small_enough = difference.count >= min_values(level) and difference.high < decision.limit
    return None if is_small_enough else outlook_of(difference, decision.limit, level=level)


def _answer(counts: tuple[int, ...], states: tuple[State, ...], failed: NDArray[np.float64]) -> tuple[Kind, int | None]:
    if np.nansum(failed) > 0.5 * np.isfinite(failed).sum():
        return "fails", counts[-1]
    good = 0
    for state in reversed(states):
        if state != "good":
            break
        good += 1
    if good:
        return "enough", counts[len(counts) - 1 - good]
    if states and states[-1] == "worse":
        return "more", counts[-2]
    return "undecided", None


def _state(
    difference: Interval, limit: float, failed: NDArray[np.float64], base: NDArray[np.float64], level: float
) -> State:
    both = np.isfinite(failed) & np.isfinite(base)
    more, fewer = int((failed[both] > base[both]).sum()), int((failed[both] < base[both]).sum())
    if more and bdtrc(more - 1, more + fewer, 0.5) < 1.0 - level:  # McNemar's exact test, one-sided
        return "worse"
    if difference.count < min_values(level):
        return "open"
    if difference.low > limit:
        return "worse"
    return "good" if difference.high < limit and np.nansum(failed) <= np.nansum(base) else "open"


def median_over_last(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median over the last axis of what is known; NaN where nothing is."""
    known = np.isfinite(values).any(axis=-1)
    medians = np.full(values.shape[:-1], np.nan)
    medians[known] = np.nanmedian(values[known], axis=-1)
    return medians


def _mean_over_last(values: NDArray[np.float64]) -> NDArray[np.float64]:
    known = np.isfinite(values).any(axis=-1)
    means = np.full(values.shape[:-1], np.nan)
    means[known] = np.nanmean(values[known], axis=-1)
    return means
