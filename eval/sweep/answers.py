# SPDX-License-Identifier: MIT
"""The answers of a sweep in words: one sentence per world, or per kind of building."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from eval.sweep.decision import MAX_UNITS, Decision, Kind
from eval.sweep.results import SweepTable
from eval.sweep.statistics import min_values, wilson_interval
from eval.sweep.summary import SweepSummary

MARKS: dict[Kind, str] = {"enough": "good", "more": "bad", "fails": "bad", "undecided": "fair"}
"""Colour of an answer, as the templates name them."""


@dataclass(frozen=True)
class Answer:
    """What a sweep says of one world, or one kind of building, with one filter."""

    place: str
    """Name of the world or log; for a kind of building with the number of worlds."""
    line: str
    kind: Kind
    short: str
    """Text for a table: `5`, `more than 15`, `undecided`."""
    headline: str
    """Sentence for a person who looks for ten seconds: `5 particles are enough`."""
    detail: str
    """The figures behind it."""
    promise: str = ""
    """How far a count that is enough may be worse, and how often it may fail."""
    scope: str = ""
    """What the answer rests on: `10 routes`; empty for logs."""

    @property
    def mark(self) -> str:
        """Colour of the answer."""
        return MARKS[self.kind]

    @property
    def short_with_noun(self) -> str:
        """Text for the title of a panel: `5 are enough`."""
        is_enough = f"{self.short} {'is' if self.short == '1' else 'are'} enough"
        return is_enough if self.kind == "enough" else "no count works" if self.kind == "fails" else self.short

    @property
    def sentence(self) -> str:
        """All of it: `office, 10 routes: 5 particles are enough (2.4 cm; 30 give 2.2 cm).`"""
        detail = f" ({self.detail})" if self.detail else ""
        return f"{self.name}: {self.headline}{detail}."

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
    decision = summary.decision(place, line)

    def failed_of(count: int) -> tuple[int, int]:
        group = summary.group(place, line, count)
        return group.failures, group.runs

    return _answer(
        summary,
        decision,
        (place, line, _scope(summary.table, [place], line)),
        median=lambda count: summary.group(place, line, count).median.value,
        failed_of=failed_of,
        unit="seed",
    )


def answer_of_family(summary: SweepSummary, family: str, line: str) -> Answer:
    """The answer for a kind of building: the unit of the statistics is the world."""
    table = summary.table
    worlds = [place for place, name in zip(table.places, table.families, strict=True) if name == family]

    def failed_of(count: int) -> tuple[int, int]:
        groups = [summary.group(place, line, count) for place in worlds]
        return sum(group.failures for group in groups), sum(group.runs for group in groups)

    return _answer(
        summary,
        summary.decision_of_family(family, line),
        (f"{family}, {len(worlds)} worlds", line, _scope(table, worlds, line)),
        median=lambda count: summary.median_of_family(family, line, count),
        failed_of=failed_of,
        unit="world",
    )


def _answer(
    summary: SweepSummary,
    decision: Decision,
    names: tuple[str, str, str],
    *,
    median: Callable[[int], float],
    failed_of: Callable[[int], tuple[int, int]],
    unit: str,
) -> Answer:
    table = summary.table
    largest = table.counts[-1]
    place, line, scope = names

    def gives(count: int) -> str:
        value = median(count)
        unit_of_value = table.measure.unit(value)
        return f"{unit_of_value.text(value)} {unit_of_value.name}".strip() if math.isfinite(value) else "no result"

    count, kind, promise = decision.count, decision.kind, ""
    if kind == "enough":
        assert count is not None
        short, headline = str(count), f"{particles(count)} {'is' if count == 1 else 'are'} enough"
        detail = f"{gives(count)}; {largest} give {gives(largest)}{_below(decision, table.counts, unit)}"
        promise = f"{_margin(decision, table, median(largest))}; {_failed(*failed_of(count), table.level)}"
    elif kind == "more":
        assert count is not None
        short, headline = f"more than {count}", f"more than {particles(count)}"
        detail = f"{count} {_give(count)} {gives(count)}, {largest} give {gives(largest)}; more were not tested"
    elif kind == "fails":
        short, headline = "none works", f"no tested count works, up to {particles(largest)}"
        failures, runs = failed_of(largest)
        detail = f"{largest} {_fail(largest)} in {failures} of {runs} runs"
    else:
        short, headline = "undecided", f"undecided with {_count(decision.units, unit)}"
        detail = _would_tell(decision, unit, table.level)
    return Answer(place, line, kind, short, headline, detail, promise, scope)


def _scope(table: SweepTable, places: Sequence[str], line: str) -> str:
    """How many routes the runs drove."""
    if table.recorded:
        return ""
    return _count(table.routes([table.places.index(place) for place in places], table.lines.index(line)), "route")


def particles(count: int) -> str:
    """`1 particle`, `5 particles`."""
    return _count(count, "particle")


def _below(decision: Decision, counts: tuple[int, ...], unit: str) -> str:
    """What is known of the counts below the one that is enough."""
    assert decision.count is not None
    lower = decision.states[: counts.index(decision.count)]
    still_open = [str(count) for count, state in zip(counts, lower, strict=False) if state == "open"]
    if not still_open:
        return ""
    would_tell = decision.needed is not None and decision.needed > decision.units
    return f"; {still_open[-1]} may be enough too" + (f", {decision.needed} {unit}s would tell" if would_tell else "")


def _margin(decision: Decision, table: SweepTable, error: float) -> str:
    """How much worse than the largest count the one that is enough may be; the part that decided comes first."""
    share = f"{100.0 * decision.limit / error:.0f} %"
    if table.measure.key.endswith("_m"):
        millimetres = 1e3 * decision.limit
        absolute = f"{millimetres:.0f} mm" if millimetres >= 10.0 else f"{millimetres:.2g} mm"
    else:
        absolute = f"{decision.limit:.2g}"
    is_share = decision.limit > table.margin.floor
    return f"At most {share} ({absolute}) worse" if is_share else f"At most {absolute} ({share}) worse"


def _failed(failures: int, runs: int, level: float) -> str:
    """How many runs failed, and how many could in the long run."""
    seen = f"{failures} of {runs} runs failed" if failures else f"no failure in {_count(runs, 'run')}"
    return f"{seen} (a rate up to {100.0 * wilson_interval(failures, runs, level=level)[1]:.0f} % is possible)"


def _would_tell(decision: Decision, unit: str, level: float) -> str:
    fewest = min_values(level)
    if decision.needed is not None:
        cannot = f"; fewer than {fewest} cannot" if decision.units < fewest else ""
        return f"about {_count(decision.needed, unit)} would probably tell{cannot}"
    if decision.units < fewest:
        return f"fewer than {_count(fewest, unit)} cannot tell"
    return f"the difference is close to the limit: more than {MAX_UNITS} {unit}s would be needed"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _give(count: int) -> str:
    return "gives" if count == 1 else "give"


def _fail(count: int) -> str:
    return "fails" if count == 1 else "fail"
