# SPDX-License-Identifier: MIT
"""What to do next where an answer is open: the commands, what they cost, and what they will be able to tell."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eval.sweep.answer_words import likely_answer
from eval.sweep.answers import answers
from eval.sweep.decision import Decision
from eval.sweep.job_times import duration_words, seconds_for_seeds
from eval.sweep.look_schedule import ADDING_LEVEL, MAX_SEEDS_UNTIL_DECIDED, MIN_CHANCE, level_of, looks_for
from eval.sweep.margin import Margin
from eval.sweep.outlook import PROBABLE, bound_for, chance_words, likely_words, rule_of_thumb
from eval.sweep.results import SweepTable
from eval.sweep.statistics import LEVEL, min_values
from eval.sweep.summary import SweepSummary

MAX_OFFERED_SHARE = 0.25
"""A margin that is a larger share of the error is not offered: within it a count would hardly be as good."""


@dataclass(frozen=True)
class Advice:
    """One thing that can be done next."""

    title: str
    command: str
    """Empty where there is nothing to enter."""
    text: str
    """What it costs and what it will be able to tell."""


def advice(summary: SweepSummary, directory: str, workers: int) -> list[Advice]:
    """What to do about the open answers of the baseline, and about fewer particles; nothing for kinds of buildings.

    directory and workers: as in the commands, `--out` and the worker processes of this machine.
    """
    table = summary.table
    if table.family_names():
        return []
    open_answers, words = _open_answers(summary), ["testbed", "sweep", "--out", directory]
    if not open_answers:
        return _fewer_particles(summary, words, workers)
    own = {place: decision for place, decision in open_answers.items() if place not in table.left}
    found = _more_seeds(summary, own, words, workers) if own else []
    ways = found + _fewer_particles(summary, words, workers) + _ways_out(summary, open_answers, found)
    return ways + _taken_up_again(table, [place for place in open_answers if place in table.left], words, workers)


def _taken_up_again(table: SweepTable, places: list[str], words: list[str], workers: int) -> list[Advice]:
    """How to go on with the worlds that the user gave up."""
    if not places:
        return []
    number = [] if table.is_sequential else ["--until", "decided"]
    text = _cost_of_looks(table, places, len(table.seeds) if table.is_sequential else MAX_SEEDS_UNTIL_DECIDED, workers)
    return [Advice(f"Take {' and '.join(places)} up again", shlex.join([*words, *number, "--give-up", "none"]), text)]


def chances(summary: SweepSummary, seeds: int) -> str:
    """The chance that so many seeds in all decide each open world, in a sentence; empty where none is open."""
    return "" if summary.table.family_names() else _chances(summary.table, _open_answers(summary), seeds)


def _open_answers(summary: SweepSummary) -> dict[str, Decision]:
    """Worlds without an answer; with `--until smallest` also those where a smaller count may be enough too."""
    is_open = {"undecided", "enough"} if summary.table.until == "smallest" else {"undecided"}
    return {
        place: decision
        for place, decision in _decisions(summary).items()
        if decision.kind in is_open and decision.largest_open is not None
    }


def _decisions(summary: SweepSummary) -> dict[str, Decision]:
    return {place: summary.decision(place, summary.table.baseline) for place in summary.table.places}


def _fewer_particles(summary: SweepSummary, words: list[str], workers: int) -> list[Advice]:
    """How to go on, where a count is enough and the sweep has ended, to whether a smaller one is too."""
    table, bound = summary.table, max(len(summary.table.seeds), MAX_SEEDS_UNTIL_DECIDED)
    if table.until != "decided":
        return []
    smaller = {
        place: decision
        for place, decision in _decisions(summary).items()
        if decision.may_be_smaller and place not in table.left and _chance(decision, bound) >= MIN_CHANCE
    }
    if not smaller:
        return []
    number = [] if bound == MAX_SEEDS_UNTIL_DECIDED else ["--seeds", str(bound)]
    others = [p for p in _open_answers(summary) if p not in table.left and not table.given_up([p], table.baseline)]
    leaving = f"--give-up {','.join(others)} leaves that"
    too = f" It goes on with {' and '.join(others)} as well; {leaving}." if others else ""
    text = (
        f"The answers stay; this asks whether a smaller count is enough too in {' and '.join(smaller)}.{too} "
        f"{_cost_of_looks(table, [*smaller, *others], bound, workers)} {_chances(table, smaller, bound)}"
    )
    return [Advice("Go on to fewer particles", shlex.join([*words, *number, "--until", "smallest"]), text)]


def _more_seeds(
    summary: SweepSummary, open_answers: dict[str, Decision], words: list[str], workers: int
) -> list[Advice]:
    """Complete what is not computed yet; else add as many seeds as will probably tell, if any number does."""
    table, bound, reopened = summary.table, len(summary.table.seeds), list[str]()
    going_on = [place for place in open_answers if not table.given_up([place], table.baseline)]
    status = table.columns["status"].astype(str)
    if np.isin(status, ("missing", "later")).any() and going_on:
        text = _cost_of_looks(table, going_on, bound, workers) if table.is_sequential else ""
        seconds = seconds_for_seeds(table, going_on, bound, workers)
        text = text or (f"In about {duration_words(seconds)}." if math.isfinite(seconds) else "")
        chance = _chances(table, {place: open_answers[place] for place in going_on}, bound)
        found = [Advice("Go on, where it was stopped", shlex.join(words), f"{text} {chance}".strip())]
        return found + _go_on_with_some(table, {place: open_answers[place] for place in going_on}, words, workers)
    if not table.is_sequential:  # with several looks the intervals are wider, also for worlds that have their answer
        table = replace(table, level=ADDING_LEVEL)
        closed = set(table.places) - set(open_answers)
        open_answers = _open_answers(SweepSummary(table, summary.groups))
        reopened = [place for place in open_answers if place in closed]
    wanted = _wanted(open_answers, table)
    if wanted is None or wanted <= bound or table.seeds != tuple(range(bound)):
        return []
    places = [p for p, d in open_answers.items() if not _is_known(table, d) or _chance(d, wanted) >= MIN_CHANCE]
    text = f"{_cost_of_looks(table, places, wanted, workers)} {_chances(table, open_answers, wanted)}"
    text += f" {_reopened(reopened, table.level)}" if reopened else ""
    text += _with_fewer_seeds(table, {place: open_answers[place] for place in places}, wanted)
    number = [] if wanted == MAX_SEEDS_UNTIL_DECIDED else ["--seeds", str(wanted)]
    until = summary.table.until or "decided"
    title = f"Raise the limit to {wanted} seeds" if summary.table.is_sequential else "Go on until it is decided"
    return [Advice(title, shlex.join([*words, *number, "--until", until]), text.strip())]


def _with_fewer_seeds(table: SweepTable, open_answers: dict[str, Decision], wanted: int) -> str:
    """That a lower limit will probably do as well, where each open answer has a bound of its own below `wanted`."""
    outlooks = [decision.outlook for decision in open_answers.values() if _is_known(table, decision)]
    enough = max((bound_for(outlook) for outlook in outlooks if outlook is not None), default=wanted)
    if len(outlooks) < len(open_answers) or enough >= wanted or enough <= len(table.seeds):
        return ""
    words = [f"{place} {chance_words(_chance(decision, enough))}" for place, decision in open_answers.items()]
    return f" With --seeds {enough} as the limit: {', '.join(words)}."


def _reopened(places: Sequence[str], level: float) -> str:
    """That worlds which have their answer from a single look are open again where several looks are taken."""
    are = "is" if len(places) == 1 else "are"
    return (
        f"Looking several times takes {100.0 * level:.3g} % intervals instead of {100.0 * LEVEL:.0f} %, with which "
        f"{' and '.join(places)} {are} open again; to keep this page, copy the directory."
    )


def _go_on_with_some(table: SweepTable, going_on: dict[str, Decision], words: list[str], workers: int) -> list[Advice]:
    """Leave the worlds that will probably stay open; where all will, that ends the sweep."""
    bound = len(table.seeds)
    poor = [p for p, d in going_on.items() if _is_known(table, d) and _chance(d, bound) < PROBABLE]
    good = [place for place in going_on if place not in poor]
    if not (table.is_sequential and poor):
        return []
    command = shlex.join([*words, "--give-up", ",".join([*table.left, *poor])])
    if not good:
        text = f"This leaves {' and '.join(poor)} open, as the cards have it, and computes no more."
        return [Advice("Stop here", command, text)]
    text = f"{_cost_of_looks(table, good, bound, workers)} What is computed of {' and '.join(poor)} stays as it is."
    return [Advice(f"Go on with {' and '.join(good)} only", command, text)]


def _cost_of_looks(table: SweepTable, places: Sequence[str], bound: int, workers: int) -> str:
    """Time to the next look of `--until decided` with so many seeds at most, and to the last one."""
    there = min(int(table.ran[table.places.index(place)].any(axis=(0, 1)).sum()) for place in places)
    looks = [look for look in looks_for(bound) if look > there]
    if not looks:
        return ""
    first, most = (duration_words(seconds_for_seeds(table, places, n, workers)) for n in (looks[0], bound))
    if len(looks) == 1:
        return f"The last look, with {bound} seeds, comes in about {most}."
    return (
        f"The next look, with {looks[0]} seeds, comes in about {first}. A world that is open then gets more, up to "
        f"{bound} seeds (about {most} at most), while its chance of an answer is {100.0 * MIN_CHANCE:.0f} % or more. "
        "Ctrl-C ends it at any time, with the answers of the last look."
    )


def _is_known(table: SweepTable, decision: Decision) -> bool:
    """Whether there are enough seeds to say how many would tell."""
    return decision.outlook is not None and decision.units >= min_values(table.level)


def _wanted(open_answers: dict[str, Decision], table: SweepTable) -> int | None:
    """The limit to offer: so many that every world that can be decided probably is, at least the usual limit.

    None if no world can be decided, and none would go on. A limit that is too high costs nothing: each world ends with
    its answer, or where it hardly has a chance of one.
    """
    if any(not _is_known(table, decision) for decision in open_answers.values()):
        return MAX_SEEDS_UNTIL_DECIDED
    outlooks = [decision.outlook for decision in open_answers.values() if decision.outlook is not None]
    probable = max((bound_for(outlook) for outlook in outlooks if outlook.high is not None), default=0)
    can_go_on = any(_chance(decision, MAX_SEEDS_UNTIL_DECIDED) >= MIN_CHANCE for decision in open_answers.values())
    return max(probable, MAX_SEEDS_UNTIL_DECIDED) if probable or can_go_on else None


def _chance(decision: Decision, seeds: int) -> float:
    """The chance that so many seeds in all decide, added by `--until decided`."""
    outlook, level = decision.outlook, level_of(looks_for(seeds))
    return 0.0 if outlook is None else outlook.chance(seeds, level=max(level, outlook.level))


def _chances(table: SweepTable, open_answers: dict[str, Decision], seeds: int) -> str:
    """The chance that so many seeds decide each world; by a rule of thumb where there are too few to say."""
    known = {place: d for place, d in open_answers.items() if _is_known(table, d)}
    few = {place: d for place, d in open_answers.items() if d.units < min_values(table.level)}
    words = [
        f"{place} {chance_words(chance)}{likely_words(chance, likely_answer(decision, table.counts))}"
        for place, decision in known.items()
        for chance in [_chance(decision, seeds)]
    ]
    sentences = [f"Chance of an answer with {seeds} seeds: {', '.join(words)}."] if words else []
    if few:
        of = " and ".join(few) if words else "a world"
        sentences.append(f"Chance of an answer for {of}: {rule_of_thumb(table.margin, seeds)}.")
    return " ".join(sentences)


def _ways_out(summary: SweepSummary, open_answers: dict[str, Decision], found: Sequence[Advice]) -> list[Advice]:
    """For each world that further seeds will probably not decide: what its seeds show all the same."""
    table = summary.table
    ways = []
    for place, decision in open_answers.items():
        if decision.kind != "undecided":
            continue
        outlook = decision.outlook
        is_probable = outlook is not None and outlook.high is not None and bool(found)
        if decision.units < min_values(table.level) or (is_probable and not table.given_up([place], table.baseline)):
            continue
        ways.append(Advice(f"{place} without further seeds", "", _report_of(summary, place, decision)))
    return ways


def _report_of(summary: SweepSummary, place: str, decision: Decision) -> str:
    """What the seeds that are there show all the same: the interval, and the margin that they decide."""
    table = summary.table
    (answer,) = [a for a in answers(summary, table.baseline) if a.place == place]
    text = f"Report the interval, as the tables below have it: {answer.difference}."
    wider = _deciding_margin(summary, place, decision)
    largest = float(summary.group(place, table.baseline, table.counts[-1]).median.value)
    if wider is None or wider[0] > MAX_OFFERED_SHARE * largest:
        return text
    margin, headline = wider
    share = f"{100.0 * margin / largest:.0f} % of the error with {table.counts[-1]}"
    unit = table.measure.unit(largest)
    return (
        f"{text} Or report what these seeds do decide: with a margin of {unit.factor * margin:.2g} {unit.name} "
        f"({share}) {headline} here. Say that this margin was chosen after {decision.units} seeds."
    )


def _deciding_margin(summary: SweepSummary, place: str, decision: Decision) -> tuple[float, str] | None:
    """The narrowest round margin with which the seeds that are there give an answer, and that answer; None if none."""
    table, c = summary.table, decision.largest_open
    assert c is not None
    high = decision.differences[c].high
    if not (math.isfinite(high) and high > 0.0):
        return None
    margin = _rounded_up(high)
    widened = SweepSummary(replace(table, margin=Margin(0.0, margin)), summary.groups)
    (answer,) = [a for a in answers(widened, table.baseline) if a.place == place]
    return (margin, answer.headline) if answer.kind == "enough" else None


def _rounded_up(value: float) -> float:
    """The next number with two digits above a value."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{step * (math.floor(value / step + 1e-9) + 1):.2g}")
