# SPDX-License-Identifier: MIT
"""The answers of a sweep in words: one sentence per world, or per kind of building."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.sweep.answer_words import (
    Case,
    alone,
    compared_medians,
    counted,
    difference_to_largest,
    difference_words,
    failure_rate,
    lower_counts,
    medians_so_far,
    of_seeds,
    particles,
    reversal,
    seeds_needed,
    too_few,
    undecided_headline,
    until_known,
    what_is_open,
    why_medians_differ,
)
from eval.sweep.decision import Decision, Kind, State, median_over_last
from eval.sweep.final_pass import after_the_final_pass
from eval.sweep.margin import share_words
from eval.sweep.results import SweepTable
from eval.sweep.statistics import Interval, min_values, paired_difference
from eval.sweep.summary import SweepSummary

MARKS: dict[Kind, str] = {"enough": "good", "more": "bad", "fails": "bad", "undecided": "fair"}
"""Colour of an answer, as the templates name them."""
WITHIN_PAIRS = "difference within pairs of runs"
"""Stands before a median of paired differences, which is not the difference of two medians."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a sweep says of one world, or one kind of building, with one filter."""

    place: str
    """Name of the world or log; for a kind of building with the number of worlds."""
    line: str
    scope: str = ""
    """What the answer rests on: `10 routes`; empty for logs."""
    kind: Kind
    short: str
    """Text for a table: `5`, `more than 15`, `undecided`."""
    panel: str
    """Text for the title of a panel: `5 are enough`, `undecided`."""
    headline: str
    """Sentence for a person who looks for ten seconds: `5 particles are enough`."""
    detail: str
    """The medians behind it, or which counts are open."""
    difference: str = ""
    """Which count was compared with the largest one, the difference, and the margin."""
    risk: str = ""
    """How often runs failed, and may fail: with the count that is enough, else with the largest one."""
    needs: str = ""
    """How many seeds would tell, where the answer is open."""
    today: str = ""
    """What to take as long as the answer is open: `take 30 for now`."""
    medians: str = ""
    """The medians so far, where the answer is open."""
    decides: str = ""
    """That not the medians decide, where they say something else than the pairs of runs."""
    caution: str = ""
    """Whether these drives ask little of the number of particles."""
    reversal: str = ""
    """Which smaller count looks better than a larger one by noise."""
    alone: str = ""
    """What one particle means, where it is enough."""
    final_pass: str = ""
    """Whether the count matters after the final pass, which `testbed run` makes by default."""
    final_pass_figures: str = ""
    """What the smallest and the largest count give after it."""

    @property
    def mark(self) -> str:
        """Colour of the answer; that a count is enough is not green where the drives ask little of it."""
        return "fair" if self.kind == "enough" and self.caution else MARKS[self.kind]

    @property
    def sentence(self) -> str:
        """All of it: `office, 10 routes: 5 particles are enough (2.4 cm; 30 give 2.2 cm).`"""
        more = "; ".join(self._reasons)
        return f"{self._short_sentence}{f' ({more})' if more else ''}."

    @property
    def lines(self) -> list[str]:
        """The answer, and below it a line for each part of what is open."""
        if self.kind == "undecided":
            first, others = f"{self._short_sentence}.", self._reasons
        else:
            detail = "; ".join(filter(None, (self.detail, self.decides)))
            first = self._short_sentence + (f" ({detail})." if detail else ".")
            others = [self.difference, self.needs]
        others = [*others, self.caution, self.risk]
        return [first, *(f"  {part[0].upper()}{part[1:]}." for part in others if part)]

    @property
    def _short_sentence(self) -> str:
        return f"{self.name}: {self.headline}{f'; {self.today}' if self.today else ''}"

    @property
    def _reasons(self) -> list[str]:
        difference = self.difference if self.kind == "undecided" else ""
        return [part for part in (self.detail, difference, self.needs) if part]

    @property
    def name(self) -> str:
        """The world with what its answer rests on: `office, 10 routes`."""
        return f"{self.place}, {self.scope}" if self.scope else self.place


def answers(summary: SweepSummary, line: str) -> list[Answer]:
    """The answers for one filter: of each kind of building, then of each world that is no sample of one."""
    table = summary.table
    families = table.family_names()
    found = [answer_of_family(summary, family, line) for family in families]
    singles = [p for p, family in zip(table.places, table.families, strict=True) if family not in families]
    return found + [answer_of_place(summary, place, line) for place in singles]


def answer_of_place(summary: SweepSummary, place: str, line: str) -> Answer:
    """The answer for one world."""

    def failed_of(count: int) -> tuple[int, int]:
        group = summary.group(place, line, count)
        return group.failures, group.runs

    decision = summary.decision(place, line)
    case = Case(
        summary.table,
        decision,
        _median(summary, [place], line, decision),
        lambda count: summary.group(place, line, count).inside_share,
        failed_of,
        _pair(summary, [place], line, _seeds_of_answer(decision, summary.table.counts)),
        _pair(summary, [place], line, slice(None)),
        "seed",
        summary.table.given_up([place], line),
        _caution(summary, [place], line),
        left_by_user=place in summary.table.left,
        final_pass=_final_pass(summary, [place], line, lambda final: final.decision(place, line)),
    )
    return _answer(case, place, line, _scope(summary.table, [place], line))


def answer_of_family(summary: SweepSummary, family: str, line: str) -> Answer:
    """The answer for a kind of building: the unit of the statistics is the world."""
    table = summary.table
    worlds = [place for place, name in zip(table.places, table.families, strict=True) if name == family]

    def failed_of(count: int) -> tuple[int, int]:
        groups = [summary.group(place, line, count) for place in worlds]
        return sum(group.failures for group in groups), sum(group.runs for group in groups)

    decision = summary.decision_of_family(family, line)
    case = Case(
        table,
        decision,
        _median(summary, worlds, line, decision),
        lambda count: float(np.median([summary.group(place, line, count).inside_share for place in worlds])),
        failed_of,
        _pair(summary, worlds, line, _seeds_of_answer(decision, table.counts)),
        _pair(summary, worlds, line, slice(None)),
        "world",
        table.given_up(worlds, line),
        _caution(summary, worlds, line),
        final_pass=_final_pass(summary, worlds, line, lambda final: final.decision_of_family(family, line)),
    )
    return _answer(case, f"{family}, {len(worlds)} worlds", line, _scope(table, worlds, line))


def _answer(case: Case, place: str, line: str, scope: str) -> Answer:
    decision, count, largest = case.decision, case.decision.count, case.largest
    risk = difference = needs = panel = today = medians = decides = ""
    if decision.kind == "enough":
        assert count is not None
        short, are = str(count), "is" if count == 1 else "are"
        headline, panel = f"{particles(count)} {are} enough", f"{count} {are} enough"
        detail, decides = f"{compared_medians(case, count)}{of_seeds(case)}", why_medians_differ(case, count)
        difference, needs = difference_to_largest(case, case.table.counts.index(count)), lower_counts(case)
        risk = f"{particles(count)}: {failure_rate(*case.failed_of(count))}"
    elif decision.kind == "more":
        assert count is not None
        short, headline = f"more than {count}", f"more than {particles(count)}"
        detail = f"{count} {_give(count)} {case.gives(count)}, {largest} give {case.gives(largest)}"
        detail += "; more were not tested"
        risk = f"{particles(largest)}: {failure_rate(*case.failed_of(largest))}"
        difference = difference_to_largest(case, len(decision.states) - 1)
    elif decision.kind == "fails":
        short, panel, headline = "none works", "no count works", f"no tested count works, up to {particles(largest)}"
        failures, runs = case.failed_of(largest)
        detail = f"{largest} {_fail(largest)} in {failures} of {runs} runs"
    else:
        short = f"too few {case.unit}s" if too_few(case) else "undecided"
        headline = undecided_headline(case)
        detail, needs = what_is_open(case), seeds_needed(case)
        risk = f"{particles(largest)}: {failure_rate(*case.failed_of(largest))}"
        if decision.largest_open is not None:
            difference = difference_to_largest(case, decision.largest_open)
            open_count = case.table.counts[decision.largest_open]
            today, medians = until_known(case), medians_so_far(case)
            decides = why_medians_differ(case, open_count)
    return Answer(
        place=place,
        line=line,
        scope=scope,
        kind=decision.kind,
        short=short,
        panel=panel or short,
        headline=headline,
        detail=detail,
        difference=difference,
        risk=risk,
        needs=needs,
        today=today,
        medians=medians,
        decides=decides,
        caution=case.caution,
        reversal=reversal(case),
        alone=alone(case.inside(1)) if count == 1 and decision.kind == "enough" else "",
        final_pass=case.final_pass[0],
        final_pass_figures=case.final_pass[1],
    )


def _seeds_of_answer(decision: Decision, counts: Sequence[int]) -> slice:
    """The seeds on which an answer rests: where a count is enough those of the look at which that was found."""
    if decision.kind != "enough" or decision.count is None:
        return slice(None)
    return decision.until_verdict(counts.index(decision.count))


def _median(summary: SweepSummary, places: Sequence[str], line: str, decision: Decision) -> Callable[[int], float]:
    """The median error of a count over the seeds that the answer rests on, or over worlds where there are several."""
    table = summary.table
    error = _of_places(table.error, table, places, line)[..., _seeds_of_answer(decision, table.counts)]

    def median(count: int) -> float:
        return float(median_over_last(_units(error[:, table.counts.index(count)])))

    return median


def _pair(summary: SweepSummary, places: Sequence[str], line: str, seeds: slice) -> Callable[[int, int], Interval]:
    """The paired differences between counts, of these seeds; a value per seed, or per world where there are several."""
    table = summary.table
    error = _of_places(table.error, table, places, line)[..., seeds]

    def pair(count: int, other: int) -> Interval:
        c, of = table.counts.index(count), table.counts.index(other)
        return _interval(_units(error[:, c] - error[:, of]), table)

    return pair


def _of_places(cube: NDArray[np.float64], table: SweepTable, places: Sequence[str], line: str) -> NDArray[np.float64]:
    """A cube of one line in some places, (places, counts, seeds)."""
    return cube[[table.places.index(place) for place in places], table.lines.index(line)]


def _units(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (places, seeds) as (units,): the seeds of one place, or the median of each of several."""
    return values[0] if len(values) == 1 else median_over_last(values)


def _interval(differences: NDArray[np.float64], table: SweepTable) -> Interval:
    """The median of differences (units,) with its interval at the level that decides."""
    return paired_difference(differences, np.zeros_like(differences), level=table.level)


def _final_pass(
    summary: SweepSummary, places: Sequence[str], line: str, decide: Callable[[SweepSummary], Decision]
) -> tuple[str, str]:
    """`if you keep the final pass, the default of testbed run, 1 does as well within the margin of 0.5 cm` and `0.27 cm
    with 1, 0.30 cm with 30 (8 runs each; paired difference: -0.01 cm [-0.21, +0.05])`; empty without one.

    decide: the decision of a summary on these places.
    """
    table = summary.table
    final = after_the_final_pass(table)
    if final is None:
        return "", ""
    decision, counts = decide(final), table.counts
    seeds = decision.until_verdict(0) if decision.seeds else slice(None)
    refined = _of_places(table.refined, table, places, line)[:, [0, -1], seeds]
    refined = np.where(np.isfinite(refined).all(axis=1, keepdims=True), refined, np.nan)  # the same drives
    difference = _interval(_units(refined[:, 0] - refined[:, 1]), table)
    if not difference.count:
        return "", ""
    medians = [float(np.nanmedian(_units(refined[:, c]))) for c in range(2)]
    unit = table.measure.unit(max(medians))
    shown = [f"{unit.factor * value:.2f} {unit.name}".rstrip() for value in medians]
    runs = counted(difference.count, "run" if len(places) == 1 else "world") + " each" * (len(places) == 1)
    level = f"; {100.0 * table.level:.3g} % interval" if difference.count >= min_values() else ""
    does = f"{counts[0]} {'does' if counts[0] == 1 else 'do'} as well"
    limit = decision.limits[0]
    margin = f"{unit.factor * limit:.2g} {unit.name}".rstrip()
    share = share_words(limit, medians[1])
    compared = f": {WITHIN_PAIRS} {difference_words(difference, unit)}"
    good = f"{does}{compared} (margin {margin}{f', {share} of the error there' if share else ''})"
    if limit > max(medians):  # that the difference is smaller then says nothing
        both = f"both errors, {' and '.join(shown)}, are below the margin of {margin}"
        good = f"{does}: {both}; {WITHIN_PAIRS} {difference_words(difference, unit)}"
    conclusions: dict[State, str] = {
        "good": good,
        "worse": f"the count still matters{compared}",
        "open": f"it is not shown whether {does}: {' against '.join(shown)}{_too_few(difference, table)}",
    }
    return (
        f"if you keep the final pass, the default of testbed run, {conclusions[decision.states[0]]}",
        f"{shown[0]} with {counts[0]}, {shown[1]} with {counts[-1]} ({runs}; paired difference: "
        f"{difference_words(difference, unit)}{level})",
    )


def _too_few(difference: Interval, table: SweepTable) -> str:
    """That there are too few runs to show anything; empty where there are enough."""
    if difference.count >= min_values(table.level):
        return ""
    return f", {difference.count} run{' is' if difference.count == 1 else 's are'} too few to tell"


def _caution(summary: SweepSummary, places: Sequence[str], line: str) -> str:
    """`8 of 8 runs with 30 never resampled: these drives ask little of the count`; empty where most runs did."""
    largest = summary.table.counts[-1]
    never, known = summary.never_resampled(places, line)
    if largest == 1 or 2 * never <= known:
        return ""
    return f"{never} of {known} runs with {largest} never resampled: these drives ask little of the count"


def _scope(table: SweepTable, places: Sequence[str], line: str) -> str:
    """How many routes the runs drove, and whether their duration cut them short."""
    if table.recorded:
        return ""
    routes = table.routes([table.places.index(place) for place in places], table.lines.index(line))
    return counted(routes, "route") + (", cut short" if table.driven_share is not None else "")


def _give(count: int) -> str:
    return "gives" if count == 1 else "give"


def _fail(count: int) -> str:
    return "fails" if count == 1 else "fail"
