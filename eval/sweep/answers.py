# SPDX-License-Identifier: MIT
"""The answers of a sweep in words: one sentence per world, or per kind of building."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from eval.sweep.decision import Decision, Kind, State, median_over_last
from eval.sweep.look_schedule import fewest_seeds_to_go_on, looks_for
from eval.sweep.margin import share_words
from eval.sweep.measure import Unit
from eval.sweep.outlook import bound_for, chance_sentence
from eval.sweep.results import SweepTable
from eval.sweep.statistics import Interval, min_values, paired_difference, wilson_interval
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
    """What to take as long as the answer is open: `take 30 for now`."""
    medians: str = ""
    """The medians so far, where the answer is open."""
    caution: str = ""
    """Whether these drives ask little of the number of particles."""
    reversal: str = ""
    """Which smaller count looks better than a larger one by noise."""
    final_pass: str = ""
    """What the smallest and the largest count give after the final pass, which `testbed run` makes by default."""

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
            first, others = self._short_sentence + (f" ({self.detail})." if self.detail else "."), [self.needs]
        others = [*others, self.caution]
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


@dataclass(frozen=True)
class _Case:
    """A decision with what is needed to put it into words."""

    table: SweepTable
    decision: Decision
    median: Callable[[int], float]
    """Median error of a count."""
    failed_of: Callable[[int], tuple[int, int]]
    """Failed runs, and runs, of a count."""
    pair: Callable[[int, int], Interval]
    """Median paired difference of a count to another one, with the interval at the level that decides."""
    unit: str
    """seed or world."""
    given_up: bool
    """Whether no more seeds are added, since they would hardly tell."""
    caution: str = ""
    """Whether these drives ask little of the number of particles, as `Answer` has it."""
    left_by_user: bool = False
    """Whether the user gave the world up, so that no more seeds are added."""
    final_pass: str = ""
    """What is left after the final pass, as `Answer` has it."""

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
        _pair(summary, [place], line),
        "seed",
        summary.table.given_up([place], line),
        _caution(summary, [place], line),
        left_by_user=place in summary.table.left,
        final_pass=_final_pass(summary, [place], line),
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
        _pair(summary, worlds, line),
        "world",
        table.given_up(worlds, line),
        _caution(summary, worlds, line),
        final_pass=_final_pass(summary, worlds, line),
    )
    return _answer(case, f"{family}, {len(worlds)} worlds", line, _scope(table, worlds, line))


def _answer(case: _Case, place: str, line: str, scope: str) -> Answer:
    decision, count, largest = case.decision, case.decision.count, case.largest
    risk = difference = needs = panel = today = medians = ""
    if decision.kind == "enough":
        assert count is not None
        short, are = str(count), "is" if count == 1 else "are"
        headline, panel = f"{particles(count)} {are} enough", f"{count} {are} enough"
        detail = _compared(case, count)
        difference, needs = _difference(case, case.table.counts.index(count)), _lower_counts(case)
        risk = _failed(*case.failed_of(count))
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
        short = f"too few {case.unit}s" if _too_few(case) else "undecided"
        headline = _undecided(case)
        detail, needs = _what_is_open(case), _needs(case)
        if decision.largest_open is not None:
            difference = _difference(case, decision.largest_open)
            today, medians = _until_known(case), _medians(case)
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
        caution=case.caution,
        reversal=_reversal(case),
        final_pass=case.final_pass,
    )


def _pair(summary: SweepSummary, places: Sequence[str], line: str) -> Callable[[int, int], Interval]:
    """The paired differences between counts, with one value per seed, or per world where there are several."""
    table = summary.table
    error = _of_places(table.error, table, places, line)

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


def _reversal(case: _Case) -> str:
    """`that 5 looks better than 15 (2.0 against 2.2 cm) is within the noise of 8 seeds`; empty where none does.

    Only the pair of counts whose medians differ most is named.
    """
    unit = case.shown_in
    medians = {count: case.median(count) for count in case.table.counts}
    pairs = [
        (medians[more] - medians[few], few, more)
        for few, more in combinations(case.table.counts, 2)
        if medians[few] < medians[more] and unit.text(medians[few]) != unit.text(medians[more])
    ]
    if not pairs:
        return ""
    _, few, more = max(pairs)
    difference = case.pair(few, more)
    against = f"{unit.text(medians[few])} against {unit.text(medians[more])} {unit.name}".rstrip()
    looks = f"that {few} {'looks' if few == 1 else 'look'} better than {more} ({against})"
    units = _count(difference.count, case.unit)
    if difference.count < min_values(case.table.level):
        return f"{looks} may be noise: {units} cannot tell"
    return f"{looks} is within the noise of {units}" if difference.contains(0.0) else ""


def _final_pass(summary: SweepSummary, places: Sequence[str], line: str) -> str:
    """`after the final pass, which testbed run makes by default: 0.30 cm with 1, 0.26 cm with 30 (8 runs each; paired
    difference to 30: +0.03 cm [-0.02, +0.10])`; empty without one."""
    table = summary.table
    counts, refined = table.counts, _of_places(table.refined, table, places, line)[:, [0, -1]]
    refined = np.where(np.isfinite(refined).all(axis=1, keepdims=True), refined, np.nan)  # the same drives
    difference = _interval(_units(refined[:, 0] - refined[:, 1]), table)
    if len(counts) < 2 or not difference.count:
        return ""
    medians = [float(np.nanmedian(_units(refined[:, c]))) for c in range(2)]
    unit = table.measure.unit(max(medians))
    shown = [f"{unit.factor * value:.2f} {unit.name}".rstrip() for value in medians]
    runs = _count(difference.count, "run" if len(places) == 1 else "world") + " each" * (len(places) == 1)
    return (
        f"after the final pass, which testbed run makes by default: {shown[0]} with {counts[0]}, {shown[1]} with "
        f"{counts[-1]} ({runs}; paired difference to {counts[-1]}: {difference_words(difference, unit)})"
    )


def _caution(summary: SweepSummary, places: Sequence[str], line: str) -> str:
    """`8 of 8 runs with 30 never resampled: these drives ask little of the count`; empty where most runs did."""
    largest = summary.table.counts[-1]
    never, known = summary.never_resampled(places, line)
    if largest == 1 or 2 * never <= known:
        return ""
    return f"{never} of {known} runs with {largest} never resampled: these drives ask little of the count"


def _compared(case: _Case, count: int) -> str:
    """The median of a count and that of the largest, with so many digits that one sees where they differ.

    `2.4 cm; 30 give 2.2 cm`, `1.76 cm; 30 give 1.77 cm`
    """
    texts = [case.gives(count), case.gives(case.largest)]
    if texts[0] == texts[1]:
        unit = case.shown_in
        exact = [f"{unit.factor * case.median(n):.2f} {unit.name}".strip() for n in (count, case.largest)]
        texts = exact if exact[0] != exact[1] else texts
    return f"{texts[0]}; {case.largest} give {texts[1]}"


def _undecided(case: _Case) -> str:
    """`undecided with 9 seeds`, or `too few seeds (3): at least 8 are needed`."""
    units = case.decision.units
    if _too_few(case):
        return f"too few {case.unit}s ({units}): at least {fewest_seeds_to_go_on(case.table.level)} are needed"
    return f"undecided with {_count(units, case.unit)}"


def _too_few(case: _Case) -> bool:
    """Whether there are too few runs for any answer."""
    return 0 < case.decision.units < min_values(case.table.level) and case.decision.largest_open is not None


def _until_known(case: _Case) -> str:
    """What to take as long as the answer is open: `take 30 for now; 5 will probably do`."""
    good = _in_state(case, "good")
    return f"take {case.largest} for now" + (f"; {good[-1]} will probably do" if good else "")


def _medians(case: _Case) -> str:
    """The medians of all counts, in the order of the counts; empty where one has no result."""
    counts = case.table.counts
    values = [case.median(count) for count in counts]
    if not all(map(math.isfinite, values)):
        return ""
    unit = case.table.measure.unit(max(values))
    first, *others = texts = [unit.text(value) for value in values]
    if len(set(texts)) == 1:
        return f"{first} {unit.name}".rstrip() + f" with {counts[0]} to {counts[-1]}"
    # in the order of the counts: a range would be read as that of the first count to that of the last
    named = [f"{first} {unit.name}".rstrip(), *others]
    return ", ".join(f"{text} with {count}" for text, count in zip(named, counts, strict=True))


def _scope(table: SweepTable, places: Sequence[str], line: str) -> str:
    """How many routes the runs drove, and whether their duration cut them short."""
    if table.recorded:
        return ""
    routes = table.routes([table.places.index(place) for place in places], table.lines.index(line))
    return _count(routes, "route") + (", cut short" if table.driven_share is not None else "")


def particles(count: int) -> str:
    """`1 particle`, `5 particles`."""
    return _count(count, "particle")


def _difference(case: _Case, c: int) -> str:
    """How a count compares with the largest one, with the interval that decides and the margin; c: its index.

    `15 particles are 0.66 cm worse than 30 [0.76 better to 1.29 worse; 99 % interval]; up to 0.5 cm (23 % of the error)
    would not matter`
    """
    difference, count = case.decision.differences[c], case.table.counts[c]
    if not difference.count:
        return ""
    matters = f"up to {_margin_length(case)} {'would' if case.decision.kind == 'undecided' else 'does'} not matter"
    if difference.count < min_values():
        return f"{count} {_were(count)} {_few_words(case, difference)}; {matters}"
    unit = case.shown_in
    value, low, high = (unit.factor * v for v in (difference.value, difference.low, difference.high))
    digits = _decimals(value, low, high)
    size = f"{abs(value):.{digits}f} {unit.name}".rstrip()
    compared = f"{size} {_side(value)} than {case.largest} in the median pair of runs"
    ends = f"{abs(low):.{digits}f}{'' if _side(low) == _side(high) else f' {_side(low)}'} to {abs(high):.{digits}f}"
    interval = f"[{ends} {_side(high)}; {100.0 * case.table.level:.3g} % interval]"
    return f"{particles(count)} {'is' if count == 1 else 'are'} {compared} {interval}; {matters}"


def _side(difference: float) -> str:
    """Whether an error that is larger by so much is worse or better."""
    return "worse" if difference >= 0.0 else "better"


def _decimals(*values: float) -> int:
    """Number of decimals that all of these values are shown with."""
    return 2 if max((abs(v) for v in values if math.isfinite(v)), default=0.0) < 10.0 else 1


def _few_words(case: _Case, difference: Interval) -> str:
    """`0.57 to 1.29 cm worse than 30 in 3 runs`, `between 0.29 cm better and 0.79 cm worse than 30 in 3 runs`."""
    unit = case.shown_in
    ends = (difference.value, difference.value) if difference.count == 1 else (difference.low, difference.high)
    low, high = (unit.factor * end for end in ends)
    runs = f"than {case.largest} in {'one run' if difference.count == 1 else f'{difference.count} runs'}"

    def text(value: float) -> str:
        return f"{abs(value):.{2 if abs(value) < 10.0 else 1}f}"

    name = f" {unit.name}" if unit.name else ""
    if low < 0.0 < high:
        return f"between {text(low)}{name} better and {text(high)}{name} worse {runs}"
    ends_text = [text(end) for end in sorted((low, high), key=abs)]
    return f"{' to '.join(dict.fromkeys(ends_text))}{name} {'worse' if high > 0.0 else 'better'} {runs}"


def _were(count: int) -> str:
    return "particle was" if count == 1 else "particles were"


def difference_words(difference: Interval, unit: Unit) -> str:
    """A difference with its interval; for fewer runs than an interval needs, the range of the runs. Empty for none."""
    if not difference.count:
        return ""
    value, low, high = (unit.factor * v for v in (difference.value, difference.low, difference.high))
    digits = _decimals(value, low, high)
    value, low, high = (round(v, digits) + 0.0 for v in (value, low, high))  # no -0.00
    name = f" {unit.name}" if unit.name else ""
    if difference.count == 1:
        return f"{value:+.{digits}f}{name} in one run"
    if difference.count < min_values():
        return f"{low:+.{digits}f} to {high:+.{digits}f}{name} in {difference.count} runs"
    return f"{value:+.{digits}f}{name} [{low:+.{digits}f}, {high:+.{digits}f}]"


def _margin_length(case: _Case) -> str:
    """The margin that counts here, with its share of the largest count's error: `0.5 cm (23 % of the error)`."""
    limit, unit = case.decision.limit, case.shown_in
    shown = f"{unit.factor * limit:.2g}" if unit.factor * limit < 100.0 else f"{unit.factor * limit:.0f}"
    share = share_words(limit, case.median(case.largest))
    return f"{shown} {unit.name}".strip() + (f" ({share} of the error)" if share else "")


def _what_is_open(case: _Case) -> str:
    """Which counts are known to be as good as the largest, and what keeps the answer open."""
    states, counts, c = case.decision.states, case.table.counts, case.decision.largest_open
    if c is None:
        return "only one count was tested" if len(counts) == 1 else ""
    parts = []
    if not _too_few(case):
        parts.append(", ".join(filter(None, (_state_words(case, state) for state in ("good", "worse", "open")))))
    if "good" in states:
        parts.append(
            f"{_in_state(case, 'good')[-1]} is an answer only when {counts[c]} passes too, since counts are tested "
            "from the largest down"
        )
    if case.decision.outlook is None and case.decision.differences[c].count >= min_values(case.table.level):
        (failed, runs), (base, of) = case.failed_of(counts[c]), case.failed_of(case.largest)
        parts.append(f"{counts[c]} failed in {failed} of {runs} runs, {case.largest} in {base} of {of}")
    return "; ".join(parts)


def _state_words(case: _Case, state: State) -> str:
    """`5 passes its own test`, `1 and 15 are open`; empty if no count is in this state."""
    found = _in_state(case, state)
    if not found:
        return ""
    names = found[0] if len(found) == 1 else f"{', '.join(found[:-1])} and {found[-1]}"
    if state == "good":
        return f"{names} {'passes its own test' if len(found) == 1 else 'pass their own tests'}"
    return f"{names} {'is' if len(found) == 1 else 'are'} {'open' if state == 'open' else 'shown to be worse'}"


def _in_state(case: _Case, state: State) -> list[str]:
    """The counts in this state, as text."""
    return [str(count) for count, own in zip(case.table.counts, case.decision.states, strict=False) if own == state]


def _needs(case: _Case) -> str:
    """How many seeds would tell; for kinds of buildings, how many worlds."""
    decision = case.decision
    if decision.largest_open is None:
        return ""
    if _too_few(case):
        return ""  # the headline says how many are needed
    if decision.outlook is None:
        return "how many would tell cannot be said"
    words = _chance_of_more(case)
    if case.left_by_user:
        units = _count(decision.units, case.unit)
        return f"you gave this world up after {units} (--give-up none takes it up again); {words}"
    return f"{words}, so no more are added" if case.given_up else words


def _chance_of_more(case: _Case) -> str:
    """The chance that further seeds or worlds decide what is open."""
    decision, table = case.decision, case.table
    assert decision.outlook is not None
    bound, likely = len(table.seeds), likely_answer(decision, table.counts)
    if case.unit == "seed" and table.is_sequential and bound > decision.units and decision.kind == "undecided":
        return chance_sentence(decision.outlook, [look for look in looks_for(bound) if look > decision.units], likely)
    return chance_sentence(decision.outlook, [bound_for(decision.outlook)], likely, case.unit)


def likely_answer(decision: Decision, counts: Sequence[int]) -> str:
    """Which answer further seeds would most likely give: `5 are enough`, `more than 15`; empty where none is open.

    The largest open count decides: where it passes, so do the counts directly below it that pass their own test.
    """
    c = decision.largest_open
    if c is None or decision.outlook is None:
        return ""
    if decision.outlook.is_within:
        while c > 0 and decision.states[c - 1] == "good":
            c -= 1
    elif decision.kind == "undecided":
        return f"more than {counts[c]}"
    verb = "is" if counts[c] == 1 else "are"
    return f"{counts[c]} {verb}{'' if decision.outlook.is_within else ' not'} enough"


def _lower_counts(case: _Case) -> str:
    """What is known of the counts below the one that is enough."""
    decision = case.decision
    if decision.largest_open is None:
        return ""
    count = case.table.counts[decision.largest_open]
    failed, runs = case.failed_of(count)
    if failed > case.failed_of(case.largest)[0]:
        return f"{count} {'is' if count == 1 else 'are'} not shown to be enough, and failed in {failed} of {runs} runs"
    words = f"{count} may be enough too"
    if case.table.is_sequential:
        new = (
            f"a new sweep of {count} and {case.largest} without --until would show it, as this one ends with its answer"
        )
        return f"{words}: {new}" + ("" if decision.outlook is None else f"; {_chance_of_more(case)}")
    return words if decision.outlook is None else f"{words}: {_chance_of_more(case)}"


def _failed(failures: int, runs: int) -> str:
    """How many runs failed, and how many could in the long run, as the figure of failures has it."""
    seen = f"{failures} of {runs} runs failed" if failures else f"no failure in {_count(runs, 'run')}"
    return f"{seen} (a rate up to {100.0 * wilson_interval(failures, runs)[1]:.0f} % is possible)"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _give(count: int) -> str:
    return "gives" if count == 1 else "give"


def _fail(count: int) -> str:
    return "fails" if count == 1 else "fail"
