# SPDX-License-Identifier: MIT
"""What a number of seeds will be able to tell, said before anything is computed."""

from __future__ import annotations

from collections.abc import Callable

from eval.sweep.job_times import duration_words
from eval.sweep.look_schedule import MAX_SEEDS_UNTIL_DECIDED, fewest_seeds_to_go_on
from eval.sweep.margin import MARGIN, Margin
from eval.sweep.outlook import TYPICAL_ERROR, chance_words, typical_outlook
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
    if units < min_values(level):
        return _too_few(units, unit, level, seconds)
    outlook = typical_outlook(level=level, margin=margin)
    share = 100.0 * outlook.detectable(units, level=level) / TYPICAL_ERROR
    return (
        f"By a rule of thumb (noise as in apartment, office and loop) {units} {unit}s show differences from about "
        f"{share:.0f} % of the error on. The chance of an answer is {chance_words(outlook.chance(units, level=level))} "
        "where a smaller count is as good as the largest; where the difference lies near the margin, any number may "
        "leave it open."
    )


def _too_few(units: int, unit: str, level: float, seconds: Callable[[int], float] | None) -> str:
    """What is needed instead of too few units, and that nobody can say whether it will do."""

    def with_time(number: int, bound: str) -> str:
        return f"{number}" if seconds is None else f"{number} ({bound} {duration_words(seconds(number))})"

    fewest = fewest_seeds_to_go_on(level)
    few = f"{units} {unit if units == 1 else f'{unit}s'} cannot tell how many particles are enough"
    unknown = f"Whether {fewest} will do cannot be said before they are computed."
    if unit != "seed":
        return f"{few}: at least {fewest} are needed. {unknown}"
    return (
        f"{few}: at least {with_time(fewest, 'about')} are needed. {unknown} --until decided looks at the results "
        f"then, and adds seeds where the answer is open, up to {with_time(MAX_SEEDS_UNTIL_DECIDED, 'at most about')}."
    )
