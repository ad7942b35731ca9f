# SPDX-License-Identifier: MIT
"""The answer of a sweep for one world or one kind of building: which particle count is enough, or why none is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

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
    """How much larger an error may be than that of the largest count, in the unit of the measure, by all runs so far;
    NaN if unknown."""
    limits: tuple[float, ...]
    """The limit that each difference was compared with: that of the look at which the verdict fell. It is not `limit`
    where the margin is a share of the largest count's error and that has changed since."""
    differences: tuple[Interval, ...]
    """Median paired difference of each count below the largest to it, with the interval that decides: that of the look
    at which the verdict fell, or of the last one where it is open."""
    seeds: tuple[int, ...]
    """How many seeds had been looked at when the verdict on each count fell; of an open one, all so far."""
    looked_at: int
    """How many seeds have been looked at."""
    outlook: Outlook | None
    """What it would take to decide the largest open count; None if none is open, or if that cannot be said."""

    @property
    def largest_open(self) -> int | None:
        """Index of the count on which the answer, or a smaller one, depends: the largest whose verdict is not good, if
        it is open. None if that one is worse, so that no smaller count can be an answer, or if all are good."""
        c = next((c for c in reversed(range(len(self.states))) if self.states[c] != "good"), None)
        return c if c is not None and self.states[c] == "open" else None

    def until_verdict(self, c: int) -> slice:
        """The seeds on which the verdict on a count rests, c: its index."""
        return slice(self.seeds[c])

    @property
    def may_be_smaller(self) -> bool:
        """Whether a count is enough, and a smaller one may be too."""
        return self.kind == "enough" and self.largest_open is not None


class _Verdict(NamedTuple):
    """What is known of one count at a look."""

    state: State
    difference: Interval
    """Median paired difference to the largest count."""
    limit: float
    """What the difference was compared with."""
    seeds: int
    """Seeds that had been looked at."""


class _Seen(NamedTuple):
    """The runs that a look at the results has seen."""

    seeds: int
    differences: NDArray[np.float64]
    """Of the counts below the largest to it, (counts - 1, units)."""
    largest: NDArray[np.float64]
    """Errors of the largest count, (units,)."""
    failures: NDArray[np.float64]
    """1 = failed, 0 = not, NaN = not run, (counts, units); or shares of the seeds of a world."""


def decide(
    counts: tuple[int, ...],
    errors: NDArray[np.float64],
    failures: NDArray[np.float64],
    *,
    margin: Margin = MARGIN,
    level: float = LEVEL,
    looks: Sequence[int] = (),
) -> Decision:
    """Decide which particle count is enough.

    counts ascending; errors (counts, units) in metres or the unit of the measure, smaller is better, NaN = no result;
    failures (counts, units), 1 = failed, 0 = not, NaN = not run; a unit is a seed. Rule: a count is enough if it, and
    every tested count above it, is worse than the largest tested count by less than the margin with confidence
    `level` (median paired difference), and fails no more often. This is a test of non-inferiority: few seeds give wide
    intervals and no answer, fewer than `min_values(level)` none at all. Nothing is said about the largest count itself,
    since no larger one was tested.

    looks: after how many seeds the results were looked at; empty = once. The verdict on a count is final at the look
    at which it falls, so that seeds which are added for smaller counts take back no answer; `level` has to allow for so
    many looks (`eval.sweep.look_schedule`).
    """
    seen = [
        _Seen(n, errors[:-1, :n] - errors[-1, :n], errors[-1, :n], failures[:, :n])
        for n in _with_results(looks, failures)
    ]
    return _decide(counts, seen, margin, level)


def decide_kind_of_building(
    counts: tuple[int, ...],
    errors: NDArray[np.float64],
    failures: NDArray[np.float64],
    *,
    margin: Margin = MARGIN,
    level: float = LEVEL,
    looks: Sequence[int] = (),
) -> Decision:
    """Decide which count is enough for a kind of building, with the world as the unit; looks: as of `decide`.

    errors and failures (worlds, counts, seeds). Each world counts once, with the median of its seeds: runs of one world
    are alike, and taking them for independent ones would make the intervals too narrow (cluster bootstrap over worlds;
    Davison, Hinkley, "Bootstrap Methods and their Application", 1997, section 3.8).
    """
    seen = [
        _Seen(
            n,
            median_over_last(errors[:, :-1, :n] - errors[:, -1:, :n]).T,
            median_over_last(errors[:, -1, :n]),
            _mean_over_last(failures[..., :n]).T,
        )
        for n in _with_results(looks, failures)
    ]
    return _decide(counts, seen, margin, level)


def _with_results(looks: Sequence[int], failures: NDArray[np.float64]) -> list[int]:
    """After how many seeds there was something to look at; the last has all that was run. failures: (…, seeds)."""
    ran = np.isfinite(failures).reshape(-1, failures.shape[-1]).any(axis=0)
    last = int(np.flatnonzero(ran)[-1]) + 1 if ran.any() else failures.shape[-1]
    return [*(look for look in looks if look < last), last]


def _decide(counts: tuple[int, ...], looks: Sequence[_Seen], margin: Margin, level: float) -> Decision:
    """The decision after these looks, each of which has seen the runs of its predecessor and more."""
    verdicts = _verdicts(looks[0], margin, level)
    for seen in looks[1:]:
        later = _verdicts(seen, margin, level)
        verdicts = [new if old.state == "open" else old for old, new in zip(verdicts, later, strict=True)]
    states, intervals = tuple(v.state for v in verdicts), tuple(v.difference for v in verdicts)
    limits, seeds = tuple(v.limit for v in verdicts), tuple(v.seeds for v in verdicts)
    known = looks[-1].largest[np.isfinite(looks[-1].largest)]
    limit = _limit(looks[-1], margin)
    kind, count = _answer(counts, states, looks[-1].failures[-1])
    decision = Decision(kind, count, states, len(known), limit, limits, intervals, seeds, looks[-1].seeds, None)
    c = decision.largest_open
    units = len(known) if kind != "undecided" or c is None else intervals[c].count
    return replace(decision, units=units, outlook=_outlook(decision, level))


def _verdicts(seen: _Seen, margin: Margin, level: float) -> list[_Verdict]:
    """What one look says of each count below the largest."""
    limit, (*failures, of_largest) = _limit(seen, margin), seen.failures
    intervals = [paired_difference(row, np.zeros_like(row), level=level) for row in seen.differences]
    return [
        _Verdict(_state(interval, limit, failed, of_largest, level), interval, limit, seen.seeds)
        for interval, failed in zip(intervals, failures, strict=True)
    ]


def _limit(seen: _Seen, margin: Margin) -> float:
    """How much larger an error may be than that of the largest count; NaN without results."""
    known = seen.largest[np.isfinite(seen.largest)]
    return margin.of(float(np.median(known))) if len(known) else math.nan


def _outlook(decision: Decision, level: float) -> Outlook | None:
    """The outlook of the largest open count; none where not the error but more failures keep it open."""
    c = decision.largest_open
    if c is None:
        return None
    difference = decision.differences[c]
    is_small_enough = difference.count >= min_values(level) and difference.high < decision.limits[c]
    return None if is_small_enough else outlook_of(difference, decision.limits[c], level=level)


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
