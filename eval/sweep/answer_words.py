# SPDX-License-Identifier: MIT
"""The sentences that make up an answer: medians, differences to the largest count, what is open, what would tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

from eval.sweep.decision import Decision, State
from eval.sweep.look_schedule import MAX_SEEDS_UNTIL_DECIDED, MIN_CHANCE, fewest_seeds_to_go_on, looks_for
from eval.sweep.margin import share_words
from eval.sweep.measure import Unit
from eval.sweep.outlook import Outlook, bound_for, chance_sentence, chance_words
from eval.sweep.results import SweepTable
from eval.sweep.statistics import Interval, min_values, wilson_interval

MAX_DECIMALS = 4
"""No end of an interval is shown with more decimals to tell it from the margin."""
FAR_APART, MIN_APART = 0.5, 0.05
"""A difference of medians is explained where the median of the differences is another one by this share of it, and by
so much in the unit that is shown."""
MIN_INSIDE = 0.8
"""A filter whose 95 % ellipsoid holds the truth in less than this share of the updates is called overconfident."""


@dataclass(frozen=True)
class Case:
    """A decision with what is needed to put it into words."""

    table: SweepTable
    decision: Decision
    median: Callable[[int], float]
    """Median error of a count."""
    inside: Callable[[int], float]
    """Median share of the updates with the truth inside the 95 % ellipsoid of a count, NaN where it is unknown."""
    failed_of: Callable[[int], tuple[int, int]]
    """Failed runs, and runs, of a count."""
    pair: Callable[[int, int], Interval]
    """Median paired difference of a count to another one, with the interval at the level that decides."""
    pair_of_all: Callable[[int, int], Interval]
    """The same of all runs, where the answer is that of an earlier look."""
    unit: str
    """seed or world."""
    given_up: bool
    """Whether no more seeds are added, since they would hardly tell."""
    caution: str = ""
    """Whether these drives ask little of the number of particles, as `Answer` has it."""
    left_by_user: bool = False
    """Whether the user gave the world up, so that no more seeds are added."""
    final_pass: tuple[str, str] = ("", "")
    """Whether the count matters after the final pass, and the figures."""

    @property
    def largest(self) -> int:
        """The largest count, to which the others are compared."""
        return self.table.counts[-1]

    @property
    def shown_in(self) -> Unit:
        """Unit in which the largest count's error, and all differences to it, are shown."""
        return self.table.measure.unit(self.median(self.largest))

    def gives(self, count: int) -> str:
        """The median error of a count: `2.4 cm`."""
        value = self.median(count)
        unit = self.table.measure.unit(value)
        return f"{unit.text(value)} {unit.name}".strip() if math.isfinite(value) else "no result"


def alone(inside: float) -> str:
    """What a single particle means; inside: share of the updates with the truth inside its 95 % ellipsoid."""
    words = "with one particle there is one map and no choice between maps: it is scan matching"
    if not inside < MIN_INSIDE:
        return words
    return f"{words}, and far too sure: the truth is inside its 95 % ellipsoid at {100.0 * inside:.0f} % of the updates"


def compared_medians(case: Case, count: int) -> str:
    """The median of a count and that of the largest, with so many digits that one sees where they differ.

    `2.4 cm; 30 give 2.2 cm`, `1.76 cm; 30 give 1.77 cm`
    """
    texts = [case.gives(count), case.gives(case.largest)]
    if texts[0] == texts[1]:
        unit = case.shown_in
        exact = [f"{unit.factor * case.median(n):.2f} {unit.name}".strip() for n in (count, case.largest)]
        texts = exact if exact[0] != exact[1] else texts
    return f"{texts[0]}; {case.largest} give {texts[1]}"


def of_seeds(case: Case) -> str:
    """` in the first 8 seeds` where the answer is that of an earlier look than the last one; else empty."""
    decision, counts = case.decision, case.table.counts
    if decision.count is None or decision.count == case.largest:
        return ""
    return after_seeds(decision, counts.index(decision.count), " in the first {} seeds")


def after_seeds(decision: Decision, c: int, words: str) -> str:
    """Words with the number of seeds after which the verdict on a count fell, if there have been more; else empty."""
    return words.format(decision.seeds[c]) if decision.seeds[c] < decision.looked_at else ""


def why_medians_differ(case: Case, count: int) -> str:
    """A clause where the medians put a count elsewhere beside the largest one than the pairs of runs do.

    The median of differences is not the difference of medians, and the former decides. `not these medians decide, which
    lie 0.04 cm apart, but the differences within pairs of runs, of which the median is 0.17 cm worse`
    """
    difference, unit = case.pair(count, case.largest), case.shown_in
    own, largest = (round(unit.factor * case.median(n), 2) for n in (count, case.largest))  # as they are shown
    apart, within = own - largest, round(unit.factor * difference.value, 2)
    off = abs(apart - within)
    if difference.count < min_values() or (apart * within >= 0.0 and off < max(FAR_APART * abs(within), MIN_APART)):
        return ""
    return (
        f"not these medians decide, which lie {f'{abs(apart):.2f} {unit.name}'.rstrip()} apart, but the differences "
        f"within pairs of runs, of which the median is {f'{abs(within):.2f} {unit.name}'.rstrip()} {_side(within)}"
    )


def reversal(case: Case) -> str:
    """`that 5 looks better than 15 (2.0 against 2.2 cm) is within the noise of 8 seeds`; empty where none does.

    Only the pair of counts whose medians differ most is named.
    """
    if of_seeds(case):  # of an earlier look: more seeds may say something else
        return ""
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
    units = counted(difference.count, case.unit)
    if difference.count < min_values(case.table.level):
        return f"{looks} may be noise: {units} cannot tell"
    return f"{looks} is within the noise of {units}" if difference.contains(0.0) else ""


def undecided_headline(case: Case) -> str:
    """`undecided with 9 seeds`, or `too few seeds (3): at least 8 are needed`."""
    units = case.decision.units
    if too_few(case):
        return f"too few {case.unit}s ({units}): at least {fewest_seeds_to_go_on(case.table.level)} are needed"
    return f"undecided with {counted(units, case.unit)}"


def too_few(case: Case) -> bool:
    """Whether there are too few runs for any answer."""
    return 0 < case.decision.units < min_values(case.table.level) and case.decision.largest_open is not None


def until_known(case: Case) -> str:
    """What to take as long as the answer is open: `take 30 for now; 5 will probably do`."""
    good = _in_state(case, "good")
    return f"take {case.largest} for now" + (f"; {good[-1]} will probably do" if good else "")


def medians_so_far(case: Case) -> str:
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


def particles(count: int) -> str:
    """`1 particle`, `5 particles`."""
    return counted(count, "particle")


def difference_to_largest(case: Case, c: int) -> str:
    """How a count compares with the largest one, with the interval that decides and the margin; c: its index.

    `15 particles are 0.66 cm worse than 30 [0.76 better to 1.29 worse; 99 % interval]; up to 0.5 cm (23 % of the error)
    would not matter`
    """
    difference, count = case.decision.differences[c], case.table.counts[c]
    if not difference.count:
        return ""
    matters = f"up to {_margin_length(case, c)} {'would' if case.decision.kind == 'undecided' else 'does'} not matter"
    after = after_seeds(case.decision, c, " after {} seeds")
    if difference.count < min_values():
        return f"{count} {_were(count)} {_few_words(case, difference)}; {matters}"
    unit = case.shown_in
    value, low, high = (unit.factor * v for v in (difference.value, difference.low, difference.high))
    digits = _decimals_apart((low, high), unit.factor * case.decision.limits[c], _decimals(value, low, high))
    size = f"{abs(value):.{digits}f} {unit.name}".rstrip()
    compared = f"{size} {_side(value)} than {case.largest} in the median pair of runs"
    ends = f"{abs(low):.{digits}f}{'' if _side(low) == _side(high) else f' {_side(low)}'} to {abs(high):.{digits}f}"
    interval = f"[{ends} {_side(high)}; {100.0 * case.table.level:.3g} % interval{after}]"
    return f"{particles(count)} {'is' if count == 1 else 'are'} {compared} {interval}{_of_all(case, count)}; {matters}"


def _of_all(case: Case, count: int) -> str:
    """`, of all 16 runs 0.14 worse` where the interval is that of an earlier look; else empty."""
    difference = case.pair_of_all(count, case.largest)
    if not of_seeds(case) or not difference.count:
        return ""
    value = case.shown_in.factor * difference.value
    runs = counted(difference.count, "run" if case.unit == "seed" else case.unit)
    return f", of all {runs} {abs(value):.{_decimals(value)}f} {_side(value)}"


def _side(difference: float) -> str:
    """Whether an error that is larger by so much is worse or better."""
    return "worse" if difference >= 0.0 else "better"


def _decimals(*values: float) -> int:
    """Number of decimals that all of these values are shown with."""
    return 2 if max((abs(v) for v in values if math.isfinite(v)), default=0.0) < 10.0 else 1


def _few_words(case: Case, difference: Interval) -> str:
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


def _decimals_apart(ends: Sequence[float], limit: float, decimals: int) -> int:
    """So many decimals that an end of an interval is not shown as the limit where it lies beside it; at most 4."""
    while decimals < MAX_DECIMALS and any(
        round(end, decimals) == round(limit, decimals) and end != limit for end in ends
    ):
        decimals += 1
    return decimals


def difference_words(difference: Interval, unit: Unit, limit: float = math.nan) -> str:
    """A difference with its interval; for fewer runs than an interval needs, the range of the runs. Empty for none.

    limit: which the interval is compared with, in the unit of the measure
    """
    if not difference.count:
        return ""
    value, low, high = (unit.factor * v for v in (difference.value, difference.low, difference.high))
    digits = _decimals_apart((low, high), unit.factor * limit, _decimals(value, low, high))
    value, low, high = (round(v, digits) + 0.0 for v in (value, low, high))  # no -0.00
    name = f" {unit.name}" if unit.name else ""
    if difference.count == 1:
        return f"{value:+.{digits}f}{name} in one run"
    if difference.count < min_values():
        return f"{low:+.{digits}f} to {high:+.{digits}f}{name} in {difference.count} runs"
    return f"{value:+.{digits}f}{name} [{low:+.{digits}f}, {high:+.{digits}f}]"


def _margin_length(case: Case, c: int) -> str:
    """The margin that a count was judged by, with its share of the largest count's error; c: index of the count.

    `0.5 cm (23 % of the error)`
    """
    limit, unit = case.decision.limits[c], case.shown_in
    shown = f"{unit.factor * limit:.2g}" if unit.factor * limit < 100.0 else f"{unit.factor * limit:.0f}"
    share = share_words(limit, case.median(case.largest))
    return f"{shown} {unit.name}".strip() + (f" ({share} of the error)" if share else "")


def what_is_open(case: Case) -> str:
    """Which counts are known to be as good as the largest, and what keeps the answer open."""
    states, counts, c = case.decision.states, case.table.counts, case.decision.largest_open
    if c is None:
        return "only one count was tested" if len(counts) == 1 else ""
    parts = []
    if not too_few(case):
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


def _state_words(case: Case, state: State) -> str:
    """`5 passes its own test`, `1 and 15 are open`; empty if no count is in this state."""
    found = _in_state(case, state)
    if not found:
        return ""
    names = found[0] if len(found) == 1 else f"{', '.join(found[:-1])} and {found[-1]}"
    if state == "good":
        return f"{names} {'passes its own test' if len(found) == 1 else 'pass their own tests'}"
    return f"{names} {'is' if len(found) == 1 else 'are'} {'open' if state == 'open' else 'shown to be worse'}"


def _in_state(case: Case, state: State) -> list[str]:
    """The counts in this state, as text."""
    return [str(count) for count, own in zip(case.table.counts, case.decision.states, strict=False) if own == state]


def seeds_needed(case: Case) -> str:
    """How many seeds would tell; for kinds of buildings, how many worlds."""
    decision = case.decision
    if decision.largest_open is None:
        return ""
    gave_up = f"you gave this world up after {counted(decision.units, case.unit)} (--give-up none takes it up again)"
    if too_few(case):  # the headline says how many are needed
        return gave_up if case.left_by_user else ""
    if decision.outlook is None:
        return "how many would tell cannot be said"
    if case.left_by_user:
        return f"{gave_up}; {_chance_of_more(case)}"
    return _why_no_more(case, decision.outlook) if case.given_up else _chance_of_more(case)


def _why_no_more(case: Case, outlook: Outlook) -> str:
    """Why the sweep adds no more seeds although the answer is open: they would hardly tell."""
    limit = max(len(case.table.seeds), MAX_SEEDS_UNTIL_DECIDED)
    return (
        f"no more seeds are added: the chance of an answer with up to {limit} is "
        f"{chance_words(outlook.chance(limit))}, and a world goes on from {100.0 * MIN_CHANCE:.0f} %"
    )


def _chance_of_more(case: Case) -> str:
    """The chance that further seeds or worlds decide what is open."""
    decision, table = case.decision, case.table
    assert decision.outlook is not None
    bound, likely = len(table.seeds), likely_answer(decision, table.counts)
    is_added = decision.kind == "undecided" or table.until == "smallest"
    if case.unit == "seed" and table.is_sequential and bound > decision.units and is_added:
        return chance_sentence(decision.outlook, [look for look in looks_for(bound) if look > decision.units], likely)
    wanted, usual = bound_for(decision.outlook), MAX_SEEDS_UNTIL_DECIDED
    # beyond the usual limit the sentence says how many are needed
    number = min(wanted, usual) if case.unit == "seed" and usual > decision.units else wanted
    return chance_sentence(decision.outlook, [number], likely, case.unit)


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


def lower_counts(case: Case) -> str:
    """What is known of the counts below the one that is enough."""
    decision = case.decision
    if decision.largest_open is None:
        return ""
    count = case.table.counts[decision.largest_open]
    failed, runs = case.failed_of(count)
    if failed > case.failed_of(case.largest)[0]:
        return f"{count} {'is' if count == 1 else 'are'} not shown to be enough, and failed in {failed} of {runs} runs"
    words = f"fewer than {decision.count} may be enough too"
    if not case.table.is_sequential:
        return words if decision.outlook is None else f"{words}: {_chance_of_more(case)}"
    if decision.outlook is None:
        return words
    if case.given_up:
        return f"{words}; {_why_no_more(case, decision.outlook)}"
    goes_on = "" if case.table.until == "smallest" else "; --until smallest goes on to it"
    return f"{words}: {_chance_of_more(case)}{goes_on}"


def failure_rate(failures: int, runs: int) -> str:
    """How many runs failed, and how many could in the long run, as the figure of failures has it."""
    if runs == 0:
        return "no runs yet"
    seen = f"{failures} of {runs} runs failed" if failures else f"no failure in {counted(runs, 'run')}"
    return f"{seen} (a rate up to {100.0 * wilson_interval(failures, runs)[1]:.0f} % is possible)"


def counted(number: int, noun: str) -> str:
    """`1 run`, `8 runs`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
