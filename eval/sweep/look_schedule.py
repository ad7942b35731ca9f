# SPDX-License-Identifier: MIT
"""When a sweep that adds seeds looks at its results, and which confidence level each look uses.

J looks would give J chances of a wrong answer, so each uses intervals of the level 1 - 0.05 / J: by Bonferroni's bound
all looks together are wrong in at most 5 % of cases. J is that of the usual limit also where a lower one was set: so a
limit can be raised, and a sweep stopped at any look, without a change to the answers that it has given.
"""

from __future__ import annotations

from eval.sweep.statistics import LEVEL, min_values

SEEDS_PER_LOOK = 8
"""Number of seeds between two looks."""
MAX_SEEDS_UNTIL_DECIDED = 40
"""Upper bound of the seeds where none is given."""
USUAL_LOOKS = MAX_SEEDS_UNTIL_DECIDED // SEEDS_PER_LOOK
"""Number of looks up to that bound."""


def looks_for(count: int) -> tuple[int, ...]:
    """After how many of `count` seeds the results are looked at, from the fewest that can decide on; last: all seeds.

    A last look that would follow its predecessor by less than half of `SEEDS_PER_LOOK` replaces it.
    """
    for first in range(SEEDS_PER_LOOK, count):
        steps = [*range(first, count, SEEDS_PER_LOOK)]
        if len(steps) > 1 and count - steps[-1] < SEEDS_PER_LOOK // 2:
            steps.pop()
        looks = (*steps, count)
        if min_values(level_of(looks)) <= first:
            return looks
    return (count,)


def level_of(looks: tuple[int, ...]) -> float:
    """Confidence level of the intervals at each of so many looks, so that all together keep `LEVEL`."""
    return 1.0 - (1.0 - LEVEL) / max(len(looks), USUAL_LOOKS)


MIN_CHANCE = 0.1
"""Seeds are added where all seeds together would decide with at least this chance."""
ADDING_LEVEL = level_of(looks_for(MAX_SEEDS_UNTIL_DECIDED))
"""Level of the intervals if seeds are added after looking at the results, up to the usual bound."""


def fewest_seeds_to_go_on(level: float) -> int:
    """The fewest seeds (or worlds) with which a sweep that has too few can be gone on with to an answer.

    level: of the intervals so far. Adding seeds after looking at the results is a further look.
    """
    return min_values(max(level, ADDING_LEVEL))
