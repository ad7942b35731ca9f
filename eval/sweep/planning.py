# SPDX-License-Identifier: MIT
"""What a number of seeds will be able to tell, said before anything is computed."""

from __future__ import annotations

from collections.abc import Callable

from eval.sweep.margin import MARGIN, Margin
from eval.sweep.outlook import chance_words, typical_outlook
from eval.sweep.statistics import LEVEL, min_values


def foresight(
    units: int,
    unit: str = "seed",
    *,
    level: float = LEVEL,
    margin: Margin = MARGIN,
    cost: Callable[[int], str] = lambda units: "",
) -> str:
    """What so many seeds (or worlds) will be able to tell, in a sentence or two.

    level: of the intervals that decide. cost: words for what so many units cost, such as `about 8 minutes`; empty if
    it is unknown.
    """
    outlook = typical_outlook(level=level, margin=margin)
    low, high = outlook.low, outlook.high
    ends = [n for n in (low, high) if n is not None]
    costs = [words for n in ends if (words := cost(n))]
    usual = f"Usually {outlook.words(unit)} tell" + (f" ({' to '.join(dict.fromkeys(costs))})" if costs else "") + "."
    fewest = min_values(level)
    if units < fewest:
        name = unit if units == 1 else f"{unit}s"
        price = f" ({words})" if (words := cost(fewest)) else ""
        return f"{units} {name} cannot show that a count is enough: at least {fewest} are needed{price}. {usual}"
    chance = chance_words(outlook.chance(units, level=level))
    return f"The chance that {units} {unit}s give an answer is {chance}, with noise as in most worlds. {usual}"
