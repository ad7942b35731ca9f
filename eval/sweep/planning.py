# SPDX-License-Identifier: MIT
"""What a number of seeds will be able to tell, said before anything is computed."""

from __future__ import annotations

from collections.abc import Callable

from eval.sweep.job_times import duration_words
from eval.sweep.look_schedule import ADDING_LEVEL, MAX_SEEDS_UNTIL_DECIDED, fewest_seeds_to_go_on
from eval.sweep.margin import MARGIN, Margin
from eval.sweep.outlook import TYPICAL_ERROR, Outlook, chance_words, typical_outlook
from eval.sweep.statistics import LEVEL, min_values

RULE = "By a rule of thumb (noise as in apartment, office and loop)"
"""On what a chance rests before anything is computed."""


def foresight(
    units: int,
    unit: str = "seed",
    *,
    level: float = LEVEL,
    margin: Margin = MARGIN,
    seconds: Callable[[int], float] | None = None,
) -> str:
    """What so many seeds (or worlds) will be able to tell, in a sentence or two.

    level: of the intervals that decide. seconds: time that so many units take [s]; None if it is unknown.
    """
    if units < min_values(level):
        return _too_few(units, unit, typical_outlook(level=ADDING_LEVEL, margin=margin), seconds)
    outlook = typical_outlook(level=level, margin=margin)
    share = 100.0 * outlook.detectable(units, level=level) / TYPICAL_ERROR
    looks = " in a single look" if level <= LEVEL else ""
    chance = chance_words(outlook.chance(units, level=level))
    return (
        f"{RULE} {units} {unit}s show differences from about {share:.0f} % of the error on{looks}. The chance of an "
        f"answer for each world is {chance} where a smaller count is as good as "
        "the largest; where the difference lies near the margin, any number may leave it open."
    )


def _too_few(units: int, unit: str, outlook: Outlook, seconds: Callable[[int], float] | None) -> str:
    """What is needed instead of too few units, and what that may show."""

    def with_time(number: int, bound: str) -> str:
        return f"{number}" if seconds is None else f"{number} ({bound} {duration_words(seconds(number))})"

    fewest, most = fewest_seeds_to_go_on(outlook.level), MAX_SEEDS_UNTIL_DECIDED
    few = f"{units} {unit if units == 1 else f'{unit}s'} cannot tell how many particles are enough"
    if unit != "seed":
        return f"{few}: at least {fewest} are needed."
    first, last = (chance_words(outlook.chance(number)) for number in (fewest, most))
    return (
        f"{few}: at least {with_time(fewest, 'about')} are needed. --until decided looks at the results then, and adds "
        f"seeds where the answer is open, up to {with_time(most, 'at most about')}. {RULE} {fewest} decide a world "
        f"with a chance {_of(first)}, {most} with one {_of(last)}; whether that holds for these worlds cannot be said "
        f"before there are {fewest}."
    )


def _of(chance: str) -> str:
    """`of about 25 %`, `under 5 %`."""
    return f"of {chance}" if chance.startswith("about") else chance
