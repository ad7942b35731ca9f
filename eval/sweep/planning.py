# SPDX-License-Identifier: MIT
"""What a number of seeds will be able to tell, said before anything is computed."""

from __future__ import annotations

from eval.sweep.answer_words import counted
from eval.sweep.look_schedule import MAX_SEEDS_UNTIL_DECIDED, fewest_seeds_to_go_on
from eval.sweep.margin import MARGIN, Margin
from eval.sweep.outlook import CONDITION, TYPICAL_ERROR, rule_of_thumb, typical_chance, typical_outlooks
from eval.sweep.statistics import LEVEL, min_values


def foresight(units: int, unit: str = "seed", *, level: float = LEVEL, margin: Margin = MARGIN) -> list[str]:
    """What so many seeds (or worlds) will be able to tell, in a few lines.

    level: of the intervals that decide.
    """
    if units < min_values(level):
        return _too_few(units, unit, level, margin)
    outlooks = typical_outlooks(level=level, margin=margin)
    low, high = (100.0 * outlook.detectable(units, level=level) / TYPICAL_ERROR for outlook in outlooks)
    chance = typical_chance(units, level=level, margin=margin)
    return [
        f"{units} {unit}s show a difference of {low:.0f} to {high:.0f} % of the error, or more.",
        f"Chance of an answer for {'a world' if unit == 'seed' else 'the kind of building'}: {chance} ({CONDITION}).",
    ]


def _too_few(units: int, unit: str, level: float, margin: Margin) -> list[str]:
    """What is needed instead of too few units, and what that may show."""
    fewest = fewest_seeds_to_go_on(level)
    few = f"{counted(units, unit)} cannot show that a count is enough; {fewest} can."
    if unit != "seed":
        return [few]
    return [
        few,
        f"--until decided takes {fewest}, looks at the results, and adds seeds where the answer is open, up to "
        f"{MAX_SEEDS_UNTIL_DECIDED}.",
        f"Chance of an answer for a world: {rule_of_thumb(margin)}. From {fewest} seeds on it is computed from your "
        "runs.",
    ]
