# SPDX-License-Identifier: MIT
"""The answers of a sweep in words: one sentence per world, or per kind of building."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from eval.sweep.decision import Decision, Kind
from eval.sweep.measure import Unit
from eval.sweep.outlook import chance_sentence, chance_words, rounded, typical_outlook
from eval.sweep.results import SweepTable
from eval.sweep.statistics import LEVEL, Interval, min_values, wilson_interval
from eval.sweep.summary import SweepSummary

MARKS: dict[Kind, str] = {"enough": "good", "more": "bad", "fails": "bad", "undecided": "fair"}
"""Colour of an answer, as the templates name them."""


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
    """The figures behind it."""
    difference: str = ""
    """Which count was compared with the largest one, the difference, and the margin."""
    risk: str = ""
    """How often a count that is enough failed, and may fail."""
    needs: str = ""
    """How many seeds would tell, where the answer is open."""
    today: str = ""
    """What to take as long as the answer is open."""

    @property
    def mark(self) -> str:
        """Colour of the answer."""
        return MARKS[self.kind]

    @property
    def sentence(self) -> str:
        """All of it: `office, 10 routes: 5 particles are enough (2.4 cm; 30 give 2.2 cm).`"""
        more = "; ".join(filter(None, (self.detail, self.difference if self.kind == "undecided" else "", self.needs)))
        return f"{self.name}: {self.headline}{f' ({more})' if more else ''}."

    @property
    def name(self) -> str:
        """The world with what its answer rests on: `office, 10 routes`."""
        return f"{self.place}, {self.scope}" if self.scope else self.place


@dataclass(frozen=True)
class _Case:
    """A decision with what is needed to put it into words."""

    table: SweepTable
    decision: Decision
    median: Callable[[int], float]
    """Median error of a count."""
    failed_of: Callable[[int], tuple[int, int]]
    """Failed runs, and runs, of a count."""
    unit: str
    """seed or world."""
    given_up: bool
    """Whether no more seeds are added, since they would hardly tell."""

    @property
    def largest(self) -> int:
        return self.table.counts[-1]

    @property
    def shown_in(self) -> Unit:
        return self.table.measure.unit(self.median(self.largest))

    def gives(self, count: int) -> str:
        value = self.median(count)
        unit = self.table.measure.unit(value)
        return f"{unit.text(value)} {unit.name}".strip() if math.isfinite(value) else "no result"


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

    case = _Case(
        summary.table,
        summary.decision(place, line),
        lambda count: summary.group(place, line, count).median.value,
        failed_of,
        "seed",
        summary.table.given_up([place], line),
    )
    return _answer(case, place, line, _scope(summary.table, [place], line))


def answer_of_family(summary: SweepSummary, family: str, line: str) -> Answer:
    """The answer for a kind of building: the unit of the statistics is the world."""
    table = summary.table
    worlds = [place for place, name in zip(table.places, table.families, strict=True) if name == family]

    def failed_of(count: int) -> tuple[int, int]:
        groups = [summary.group(place, line, count) for place in worlds]
        return sum(group.failures for group in groups), sum(group.runs for group in groups)

    case = _Case(
        table,
        summary.decision_of_family(family, line),
        lambda count: summary.median_of_family(family, line, count),
        failed_of,
        "world",
        table.given_up(worlds, line),
    )
    return _answer(case, f"{family}, {len(worlds)} worlds", line, _scope(table, worlds, line))


def _answer(case: _Case, place: str, line: str, scope: str) -> Answer:
    decision, count, largest = case.decision, case.decision.count, case.largest
    risk = difference = needs = panel = today = ""
    if decision.kind == "enough":
        assert count is not None
        short, are = str(count), "is" if count == 1 else "are"
        headline, panel = f"{particles(count)} {are} enough", f"{count} {are} enough"
        detail = f"{case.gives(count)}; {largest} give {case.gives(largest)}"
        difference, needs = _difference(case, case.table.counts.index(count)), _lower_counts(case)
        risk = _failed(*case.failed_of(count), case.table.level)
    elif decision.kind == "more":
        assert count is not None
        short, headline = f"more than {count}", f"more than {particles(count)}"
        detail = f"{count} {_give(count)} {case.gives(count)}, {largest} give {case.gives(largest)}"
        detail += "; more were not tested"
        difference = _difference(case, len(decision.states) - 1)
    elif decision.kind == "fails":
        short, panel, headline = "none works", "no count works", f"no tested count works, up to {particles(largest)}"
        failures, runs = case.failed_of(largest)
        detail = f"{largest} {_fail(largest)} in {failures} of {runs} runs"
    else:
        short, headline = "undecided", _undecided(case)
        detail, needs, today = _what_is_open(case), _needs(case), _until_known(case)
        if decision.largest_open is not None:
            difference = _difference(case, decision.largest_open)
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
    )


def _undecided(case: _Case) -> str:
    """`undecided with 9 seeds`, or that so few cannot tell."""
    units, fewest = case.decision.units, min_values(case.table.level)
    if 0 < units < fewest and case.decision.largest_open is not None:
        return f"{_count(units, case.unit)} cannot tell: {fewest} or more are needed"
    return f"undecided with {_count(units, case.unit)}"


def _until_known(case: _Case) -> str:
    """What to take as long as the answer is open, and how much the counts differ so far."""
    counts = case.table.counts
    values = [case.median(count) for count in counts]
    if case.decision.largest_open is None or not all(map(math.isfinite, values)):
        return ""
    unit = case.table.measure.unit(max(values))
    texts = [unit.text(value) for value in values]
    if len(set(texts)) == 1:
        medians = f"{texts[0]} {unit.name}".rstrip() + f" with {counts[0]} to {counts[-1]}"
    else:  # in the order of the counts: a range would be read as that of the first count to that of the last
        each = ", ".join(f"{text} with {count}" for text, count in zip(texts, counts, strict=True))
        medians = f"{each} ({unit.name})" if unit.name else each
    return f"Until it is known take {counts[-1]}; medians so far: {medians}"


def _scope(table: SweepTable, places: Sequence[str], line: str) -> str:
    """How many routes the runs drove."""
    if table.recorded:
        return ""
    return _count(table.routes([table.places.index(place) for place in places], table.lines.index(line)), "route")


def particles(count: int) -> str:
    """`1 particle`, `5 particles`."""
    return _count(count, "particle")


def _difference(case: _Case, c: int) -> str:
    """`15 against 30: +0.57 cm [-0.20, +1.24], margin 0.5 cm`; c: index of the count."""
    difference, count = case.decision.differences[c], case.table.counts[c]
    if not difference.count:
        return ""
    if difference.count < min_values():
        return f"{count} {_were(count)} {_few_words(case, difference)}; up to {_margin_length(case)} would not matter"
    level = "" if case.table.level <= LEVEL else f" ({100.0 * case.table.level:.3g} % interval)"
    shown = difference_words(difference, case.shown_in)
    return f"{count} against {case.largest}: {shown}{level}, margin {_margin_length(case)}"


def _few_words(case: _Case, difference: Interval) -> str:
    """`0.57 to 1.29 cm worse than 30 in 3 runs`, `between 0.29 cm better and 0.79 cm worse than 30 in 3 runs`."""
    unit = case.shown_in
    ends = (difference.value, difference.value) if difference.count == 1 else (difference.low, difference.high)
    low, high = (unit.factor * end for end in ends)
    runs = f"than {case.largest} in {'one run' if difference.count == 1 else f'{difference.count} runs'}"

    def text(value: float) -> str:
        return f"{abs(value):.{2 if abs(value) < 10.0 else 1}f}"

    if low < 0.0 < high:
        return f"between {text(low)} {unit.name} better and {text(high)} {unit.name} worse {runs}"
    ends_text = [text(end) for end in sorted((low, high), key=abs)]
    return f"{' to '.join(dict.fromkeys(ends_text))} {unit.name} {'worse' if high > 0.0 else 'better'} {runs}"


def _were(count: int) -> str:
    return "particle was" if count == 1 else "particles were"


def difference_words(difference: Interval, unit: Unit) -> str:
    """A difference with its interval; for fewer runs than an interval needs, the range of the runs. Empty for none."""
    if not difference.count:
        return ""
    value, low, high = (unit.factor * v for v in (difference.value, difference.low, difference.high))
    digits = 2 if max(abs(v) for v in (value, low, high) if math.isfinite(v)) < 10.0 else 1
    name = f" {unit.name}" if unit.name else ""
    if difference.count == 1:
        return f"{value:+.{digits}f}{name} in one run"
    if difference.count < min_values():
        return f"{low:+.{digits}f} to {high:+.{digits}f}{name} in {difference.count} runs"
    return f"{value:+.{digits}f}{name} [{low:+.{digits}f}, {high:+.{digits}f}]"


def _margin_length(case: _Case) -> str:
    """The margin that counts here: `0.5 cm`, `1.2 cm (10 %)`."""
    limit, margin, unit = case.decision.limit, case.table.margin, case.shown_in
    shown = f"{unit.factor * limit:.2g}" if unit.factor * limit < 100.0 else f"{unit.factor * limit:.0f}"
    text = f"{shown} {unit.name}".strip()
    return f"{text} ({100.0 * margin.share:g} %)" if limit > margin.floor else text


def _what_is_open(case: _Case) -> str:
    """Which counts are known to be as good as the largest, and what keeps the answer open."""
    states, counts, c = case.decision.states, case.table.counts, case.decision.largest_open
    if c is None:
        return "only one count was tested" if len(counts) == 1 else ""
    good = [str(count) for count, state in zip(counts, states, strict=False) if state == "good"]
    parts = []
    if good:
        words = f"{' and '.join(good)} {'is' if len(good) == 1 else 'are'} shown to be as good as {case.largest}"
        parts.append(f"{words}, {counts[c]} not yet; an answer needs {'both' if len(good) == 1 else 'all'}")
    if case.decision.outlook is None and case.decision.differences[c].count >= min_values(case.table.level):
        (failed, runs), (base, of) = case.failed_of(counts[c]), case.failed_of(case.largest)
        parts.append(f"{counts[c]} failed in {failed} of {runs} runs, {case.largest} in {base} of {of}")
    return "; ".join(parts)


def _needs(case: _Case) -> str:
    """How many seeds would tell; for kinds of buildings, how many worlds."""
    decision, table = case.decision, case.table
    if decision.largest_open is None:
        return ""
    few = decision.units < min_values()
    if decision.outlook is None:
        usual = typical_outlook(level=table.level, margin=table.margin)
        return f"usually {usual.words(case.unit)} tell" if few else "how many would tell cannot be said"
    if few:
        low = decision.outlook.low
        least = "more than 200" if low is None else f"{rounded(low)} or more"
        return f"{_count(decision.units, case.unit)} cannot say how many are needed: probably {least}"
    bound = len(table.seeds)
    if case.unit == "world" or not table.is_sequential or bound <= decision.units:
        return chance_sentence(decision.outlook, case.unit)
    high = decision.outlook.high
    if high is not None and high <= bound:
        most = f"{rounded(high)} give 80 %"
    else:
        most = f"for 80 % {'more than 200' if high is None else rounded(high)} are needed"
    chance = f"with {bound} seeds the chance of an answer is {chance_words(decision.outlook.chance(bound))}"
    return f"{chance}" + (", so no more are added" if case.given_up else f"; {most}")


def _lower_counts(case: _Case) -> str:
    """What is known of the counts below the one that is enough."""
    decision = case.decision
    if decision.largest_open is None:
        return ""
    count = case.table.counts[decision.largest_open]
    words = f"{count} may be enough too"
    return words if decision.outlook is None else f"{words}: {chance_sentence(decision.outlook, case.unit)}"


def _failed(failures: int, runs: int, level: float) -> str:
    """How many runs failed, and how many could in the long run."""
    seen = f"{failures} of {runs} runs failed" if failures else f"no failure in {_count(runs, 'run')}"
    return f"{seen} (a rate up to {100.0 * wilson_interval(failures, runs, level=level)[1]:.0f} % is possible)"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _give(count: int) -> str:
    return "gives" if count == 1 else "give"


def _fail(count: int) -> str:
    return "fails" if count == 1 else "fail"
