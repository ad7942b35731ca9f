# SPDX-License-Identifier: MIT
"""What to do next where an answer is open: the commands, what they cost, and what they will be able to tell."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eval.sweep.answers import answers
from eval.sweep.decision import Decision
from eval.sweep.job_times import duration_words, seconds_for_seeds
from eval.sweep.look_schedule import MAX_SEEDS_UNTIL_DECIDED, SEEDS_PER_LOOK, level_of, looks_for
from eval.sweep.margin import Margin
from eval.sweep.outlook import MAX_UNITS, SOME, chance_words
from eval.sweep.results import SweepTable
from eval.sweep.statistics import min_values
from eval.sweep.summary import SweepSummary


@dataclass(frozen=True)
class Advice:
    """One thing that can be done next."""

    title: str
    command: str
    """Empty where there is nothing to enter."""
    text: str
    """What it costs and what it will be able to tell."""


def advice(summary: SweepSummary, directory: str, workers: int) -> list[Advice]:
    """What to do about the open answers of the baseline; nothing where none is open, or for kinds of buildings.

    directory and workers: as in the commands, `--out` and the worker processes of this machine.
    """
    table = summary.table
    if table.family_names():
        return []
    open_answers = _open_answers(summary)
    if not open_answers:
        return []
    words = ["testbed", "sweep", "--out", directory]
    found = _more_seeds(table, open_answers, words, workers)
    return found + _ways_out(summary, open_answers, found)


def chances(summary: SweepSummary, seeds: int) -> str:
    """The chance that so many seeds in all decide each open world, in a sentence; empty where it cannot be said."""
    return "" if summary.table.family_names() else _chances(_open_answers(summary), seeds)


def _open_answers(summary: SweepSummary) -> dict[str, Decision]:
    table = summary.table
    decisions = {place: summary.decision(place, table.baseline) for place in table.places}
    return {
        place: decision
        for place, decision in decisions.items()
        if decision.kind == "undecided" and decision.largest_open is not None
    }


def _more_seeds(table: SweepTable, open_answers: dict[str, Decision], words: list[str], workers: int) -> list[Advice]:
    """Complete what is not computed yet; else add as many seeds as will probably tell, if any number does."""
    bound = len(table.seeds)
    going_on = [place for place in open_answers if not table.given_up([place], table.baseline)]
    status = table.columns["status"].astype(str)
    if np.isin(status, ("missing", "later")).any() and going_on:
        text = _cost_of_looks(table, going_on, bound, workers) if table.is_sequential else ""
        text = text or f"In about {duration_words(seconds_for_seeds(table, going_on, bound, workers))}."
        chance = _chances({place: open_answers[place] for place in going_on}, bound)
        return [Advice("Go on", shlex.join(words), f"{text} {chance}")]
    wanted = _wanted(open_answers, table)
    if wanted is None or wanted <= bound or table.seeds != tuple(range(bound)):
        return []
    places = [place for place, d in open_answers.items() if _chance(d, wanted) >= SOME or not _is_known(d)]
    text = f"{_cost_of_looks(table, places, wanted, workers)} {_chances(open_answers, wanted)}"
    return [Advice("Add seeds", shlex.join([*words, "--seeds", str(wanted), "--until", "decided"]), text)]


def _cost_of_looks(table: SweepTable, places: Sequence[str], bound: int, workers: int) -> str:
    """Time to the next look of `--until decided` with so many seeds at most, and to the last one."""
    there = min(int(table.ran[table.places.index(place)].any(axis=(0, 1)).sum()) for place in places)
    looks = [look for look in looks_for(bound) if look > there]
    if not looks:
        return ""
    first, most = (duration_words(seconds_for_seeds(table, places, n, workers)) for n in (looks[0], bound))
    return (
        f"The next look, with {looks[0]} seeds, is there in about {first}; a world ends when its answer is known, or "
        f"its chance falls below 10 %; all end after at most about {most}."
    )


def _is_known(decision: Decision) -> bool:
    """Whether there are enough seeds to say how many would tell."""
    return decision.outlook is not None and decision.units >= min_values()


def _wanted(open_answers: dict[str, Decision], table: SweepTable) -> int | None:
    """How many seeds to aim at: so many that every world that can be decided probably is; None if none can."""
    if any(not _is_known(decision) for decision in open_answers.values()):
        return MAX_SEEDS_UNTIL_DECIDED
    found = [decision.outlook.high for decision in open_answers.values() if decision.outlook is not None]
    reachable = [number for number in found if number is not None]
    if not reachable:
        return None
    steps = range(2 * SEEDS_PER_LOOK, MAX_UNITS + 1, SEEDS_PER_LOOK)
    return next((n for n in steps if n >= max(reachable)), MAX_UNITS)


def _chance(decision: Decision, seeds: int) -> float:
    """The chance that so many seeds in all decide, added by `--until decided`."""
    outlook, level = decision.outlook, level_of(looks_for(seeds))
    return 0.0 if outlook is None else outlook.chance(seeds, level=max(level, outlook.level))


def _chances(open_answers: dict[str, Decision], seeds: int) -> str:
    """The chance that so many seeds decide each world; empty where it cannot be said."""
    known = {place: decision for place, decision in open_answers.items() if decision.outlook is not None}
    words = [f"{place} {chance_words(_chance(decision, seeds))}" for place, decision in known.items()]
    rough = "" if all(map(_is_known, known.values())) else ", roughly"
    return f"Chance of an answer with {seeds} seeds{rough}: {', '.join(words)}." if words else ""


def _ways_out(summary: SweepSummary, open_answers: dict[str, Decision], found: Sequence[Advice]) -> list[Advice]:
    """For each world that further seeds will probably not decide: what its seeds show all the same."""
    table = summary.table
    ways = []
    for place, decision in open_answers.items():
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
    text = f"Report the interval: {answer.difference}."
    wider = _deciding_margin(summary, place, decision)
    if wider is None:
        return text
    margin, headline = wider
    largest = float(summary.group(place, table.baseline, table.counts[-1]).median.value)
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
