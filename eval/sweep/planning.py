# SPDX-License-Identifier: MIT
"""What a number of seeds will be able to tell, said before anything is computed."""

from __future__ import annotations

from eval.sweep.look_schedule import MAX_SEEDS_UNTIL_DECIDED, fewest_seeds_to_go_on
from eval.sweep.margin import MARGIN, Margin
from eval.sweep.outlook import CONDITION, RULE, TYPICAL_ERROR, chance_words, rule_of_thumb, typical_outlook
from eval.sweep.statistics import LEVEL, min_values


def foresight(
    units: int,
    unit: str = "seed",
    *,
    level: float = LEVEL,
    margin: Margin = MARGIN,
) -> str:
    """What so many seeds (or worlds) will be able to tell, in a sentence or two.

    level: of the intervals that decide.
    """
    if units < min_values(level):
        return _too_few(units, unit, level, margin)
    outlook = typical_outlook(level=level, margin=margin)
    share = 100.0 * outlook.detectable(units, level=level) / TYPICAL_ERROR
    looks = " in a single look" if level <= LEVEL else ""
    chance = chance_words(outlook.chance(units, level=level))
    return (
        f"{RULE[0].upper()}{RULE[1:]} {units} {unit}s show differences from about {share:.0f} % of the error "
        f"on{looks}. The chance of an answer for each world is {chance} {CONDITION}."
    )


def _too_few(units: int, unit: str, level: float, margin: Margin) -> str:
    """What is needed instead of too few units, and what that may show."""
    fewest = fewest_seeds_to_go_on(level)
    few = f"Too few {unit}s ({units}) to tell how many particles are enough"
    if unit != "seed":
        return f"{few}: at least {fewest} are needed."
    rule = rule_of_thumb(margin)
    return (
        f"{few}: at least {fewest} are needed. --until decided looks at the results then, and adds seeds where the "
        f"answer is open, up to {MAX_SEEDS_UNTIL_DECIDED}. {rule[0].upper()}{rule[1:]}. With {fewest} seeds or "
        "more the chance is computed from your own runs."
    )
