# SPDX-License-Identifier: MIT
"""What a number of seeds will be able to tell, said before anything is computed."""

from __future__ import annotations

from collections.abc import Callable

from eval.sweep.job_times import duration_words, range_words
from eval.sweep.margin import MARGIN, Margin
from eval.sweep.outlook import chance_words, typical_outlook
from eval.sweep.statistics import LEVEL, min_values


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
    outlook = typical_outlook(level=level, margin=margin)
    usual = f"Usually {outlook.words(unit)} tell"
    if seconds is not None and outlook.low is not None and outlook.high is not None:
        usual += f" ({range_words(seconds(outlook.low), seconds(outlook.high))})"
    fewest = min_values(level)
    if units < fewest:
        name = unit if units == 1 else f"{unit}s"
        price = "" if seconds is None else f" (about {duration_words(seconds(fewest))})"
        return f"{units} {name} cannot show that a count is enough: at least {fewest} are needed{price}. {usual}."
    chance = chance_words(outlook.chance(units, level=level))
    return f"The chance that {units} {unit}s give an answer is {chance}, with noise as in most worlds. {usual}."
