# SPDX-License-Identifier: MIT
"""How many seeds (or worlds) would tell: one estimate for the plan, the page, and the lines after each look.

The estimate is the chance that N seeds decide on which side of the margin a difference lies, given the seeds that are
there. It takes into account that both the difference and its spread are only estimated: the difference that N seeds
will show is drawn around the present one, and the variance from its chi-square distribution. A few seeds therefore give
a wide range. Source: Spiegelhalter, Freedman, Blackburn, "Monitoring clinical trials: conditional or predictive
power?", Controlled Clinical Trials 7(1), 1986.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtri, ndtr, stdtrit

from eval.sweep.look_schedule import (
    ADDING_LEVEL,
    MAX_SEEDS_UNTIL_DECIDED,
    SEEDS_PER_LOOK,
    level_of,
    looks_for,
)
from eval.sweep.margin import MARGIN, Margin
from eval.sweep.statistics import Interval, min_values, minimum_detectable_effect

MAX_UNITS = 200
"""More seeds or worlds than this are not counted out."""
FEW = 16
"""From fewer seeds or worlds, how many are needed can be wrong by several times."""
SOME, MOST = 0.2, 0.8
"""The range of an `Outlook` begins where one in five such sweeps is decided, and ends where four in five are."""
TYPICAL_DEVIATIONS = (0.2, 0.45)
"""Standard deviation between seeds of the paired difference of two counts, as a share of the error: in a world whose
routes are alike, and in one where they are not. A rule of thumb: 0.2 in apartment, 0.35 in loop with an error a third
above the typical one (the two largest counts of several sweeps with random routes)."""
TYPICAL_ERROR = 0.015
"""Error of the filter's path in these worlds [m]."""
TYPICAL_UNITS = 6
"""The rule of thumb is trusted as much as a measurement with so many seeds."""
CONDITION = "rule of thumb, by how much runs of a world differ; less where the difference lies near the margin"
"""On what a chance rests before anything is computed: noise as in the reference worlds apartment and loop, and a
smaller count that is as good as the largest."""
_MEDIAN = math.sqrt(math.pi / 2.0)
"""Standard error of a median of normal values, as a multiple of that of their mean."""
_QUANTILES = (np.arange(64) + 0.5) / 64


@dataclass(frozen=True)
class Outlook:
    """What is known of a difference whose side of the margin is open."""

    gap: float
    """From the difference to the margin, in the unit of the measure."""
    deviation: float
    """Spread: the standard error of the difference with n units is `deviation` / sqrt(n)."""
    units: int
    """Seeds or worlds from which both are estimated."""
    level: float = ADDING_LEVEL
    """Confidence level of the intervals that will decide."""
    is_measured: bool = True
    """False: a rule of thumb. Its units are not among those that will be computed."""

    @property
    def is_within(self) -> bool:
        """Whether an answer would most likely be that the difference lies within the margin."""
        return self.gap > 0.0

    def chance(self, units: int, *, level: float | None = None) -> float:
        """The chance that so many units in all decide the question, 0 to 1.

        level: of the intervals; default: that of the outlook.
        """
        level = self.level if level is None else level
        if units < min_values(level) or self.units < 2 or (self.is_measured and units <= self.units):
            return 0.0
        if self.deviation <= 0.0:
            return float(self.gap != 0.0)
        spread = 1.0 / self.units + (-1.0 if self.is_measured else 1.0) / units
        critical = float(stdtrit(units - 1, 0.5 + 0.5 * level)) / math.sqrt(units)
        scale = self.deviation * np.sqrt((self.units - 1) / chdtri(self.units - 1, _QUANTILES))
        gap = abs(self.gap) / scale
        width = math.sqrt(spread)
        return float(np.mean(ndtr((gap - critical) / width) + ndtr((-gap - critical) / width)))

    def detectable(self, units: int, *, level: float) -> float:
        """The smallest difference that so many units show in 80 % of cases, in the unit of the measure."""
        error = Interval(math.nan, math.nan, math.nan, self.deviation / math.sqrt(units), units)
        return minimum_detectable_effect(error, level=level)

    @cached_property
    def low(self) -> int | None:
        """With so many units one in five such sweeps is decided; None: with more than `MAX_UNITS`."""
        return self.units_for(SOME)

    @cached_property
    def high(self) -> int | None:
        """With so many units four in five such sweeps are decided; None: with more than `MAX_UNITS`."""
        return self.units_for(MOST)

    def units_for(self, chance: float) -> int | None:
        """The fewest units that decide with this chance; None for more than `MAX_UNITS`."""
        fewest = max(min_values(self.level), self.units + 1 if self.is_measured else 0)
        return next((n for n in range(fewest, MAX_UNITS + 1) if self.chance(n) >= chance), None)


def bound_for(outlook: Outlook) -> int:
    """How many units to aim at: the fewest, in whole steps between looks, that decide in four of five sweeps; at most
    `MAX_UNITS`."""
    steps = range(2 * SEEDS_PER_LOOK, MAX_UNITS, SEEDS_PER_LOOK)
    high = MAX_UNITS if outlook.high is None else outlook.high
    return next((number for number in steps if number >= high), MAX_UNITS)


PROBABLE = 0.5
"""Which answer is the likely one is said where there will be one with at least this chance."""


def likely_words(chance: float, likely: str) -> str:
    """` (most likely: 5 are enough)` beside a chance of any answer; empty where most likely there will be none."""
    return f" (most likely: {likely})" if chance >= PROBABLE and likely else ""


def chance_sentence(outlook: Outlook, looks: Sequence[int], likely: str, unit: str = "seed") -> str:
    """The chance of an answer at the first of these looks that probably has one, else at the last.

    `with 16 seeds the chance of any answer is about 85 % (most likely: 5 are enough)`. looks: after how many units the
    results are looked at; likely: the most likely answer, in words.
    """
    chances = {look: outlook.chance(look) for look in looks}
    look = next((look for look, chance in chances.items() if chance >= MOST), looks[-1])
    chance = chances[look]
    said = f"with {look} {unit}s the chance of any answer is {chance_words(chance)}{likely_words(chance, likely)}"
    if round(20.0 * chance) >= 20.0 * MOST or look >= MAX_UNITS:
        return said
    more = bound_for(outlook)
    needed = f"more than {MAX_UNITS}" if outlook.high is None or more <= look else f"about {more}"
    rough = f" (a rough guess from {outlook.units})" if outlook.units < FEW else ""
    return f"{said}; for {100.0 * MOST:.0f} % {needed} are needed{rough}"


def outlook_of(difference: Interval, limit: float, *, level: float) -> Outlook | None:
    """The outlook of a measured difference; None if nothing can be said, such as from fewer than two values.

    Seeds that are added after a look are a further look, so at least the level of `--until decided` is assumed.
    """
    if difference.count < 2 or not math.isfinite(limit):
        return None
    deviation = difference.standard_error * math.sqrt(difference.count)
    return Outlook(limit - difference.value, deviation, difference.count, max(level, ADDING_LEVEL))


def typical_outlooks(*, level: float = ADDING_LEVEL, margin: Margin = MARGIN) -> tuple[Outlook, Outlook]:
    """The outlooks before anything is computed, for a count that is as good as the largest one: in a world whose runs
    are alike, and in one where they differ."""
    alike, different = (_MEDIAN * deviation * TYPICAL_ERROR for deviation in TYPICAL_DEVIATIONS)
    gap, least = margin.of(TYPICAL_ERROR), max(level, ADDING_LEVEL)
    return (
        Outlook(gap, alike, TYPICAL_UNITS, least, is_measured=False),
        Outlook(gap, different, TYPICAL_UNITS, least, is_measured=False),
    )


def typical_chance(units: int, *, level: float, margin: Margin) -> str:
    """How likely so many units decide, before any measurement says so: `about 10 to 45 %`."""
    low, high = sorted(
        5 * round(20.0 * outlook.chance(units, level=level)) for outlook in typical_outlooks(level=level, margin=margin)
    )
    return f"about {low} %" if low == high else f"about {low} to {high} %"


def rule_of_thumb(margin: Margin, most: int = MAX_SEEDS_UNTIL_DECIDED) -> str:
    """How likely the first and the last look of `--until decided` decide a world, before any measurement says so.

    `8 seeds about 10 to 50 %, 40 about 65 to 90 % (rule of thumb, …)`. most: seeds at the last look
    """
    looks = looks_for(max(most, min_values(ADDING_LEVEL)))
    first, last = (typical_chance(look, level=level_of(looks), margin=margin) for look in (looks[0], looks[-1]))
    later = "" if len(looks) == 1 else f", {looks[-1]} {last}"
    return f"{looks[0]} seeds {first}{later} ({CONDITION})"


def chance_words(chance: float) -> str:
    """A chance in words, no finer than it is known: `under 5 %`, `about 25 %`, `over 95 %`."""
    if chance < 0.05:
        return "under 5 %"
    return "over 95 %" if chance > 0.95 else f"about {5 * round(20.0 * chance)} %"
