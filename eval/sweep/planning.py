# SPDX-License-Identifier: MIT
"""What a number of seeds will be able to tell, said before anything is computed."""

from __future__ import annotations

import math

from scipy.special import stdtrit

from eval.sweep.decision import MAX_UNITS
from eval.sweep.margin import MARGIN, Margin
from eval.sweep.statistics import LEVEL, POWER, min_values

TYPICAL_DEVIATION = 0.25
"""Standard deviation between seeds of the paired difference of two counts, as a share of the error. A rule of thumb:
0.29 in office and 0.15 in apartment (2 and 10 particles, 10 random routes each). The page of a sweep uses its own."""
TYPICAL_ERROR = 0.02
"""Error of the filter's path in these worlds [m]."""
_MEDIAN = math.sqrt(math.pi / 2.0)
"""Standard error of a median of normal values, as a multiple of that of their mean."""


def detectable_share(seeds: int, *, level: float = LEVEL) -> float:
    """Smallest difference between two counts that so many seeds show with probability `POWER`, as share of the error.

    For typical noise (`TYPICAL_DEVIATION`); infinite for fewer than two seeds. Source: see
    `eval.sweep.statistics.minimum_detectable_effect`.
    """
    if seeds < 2:
        return math.inf
    quantiles = float(stdtrit(seeds - 1, 0.5 + 0.5 * level) + stdtrit(seeds - 1, POWER))
    return quantiles * _MEDIAN * TYPICAL_DEVIATION / math.sqrt(seeds)


def typical_seeds(*, level: float = LEVEL, margin: Margin = MARGIN) -> int:
    """How many seeds show with probability `POWER` that a count is enough if it is as good as the largest one."""
    limit = margin.of(TYPICAL_ERROR) / TYPICAL_ERROR
    fewest = min_values(level)
    return next((n for n in range(fewest, MAX_UNITS) if detectable_share(n, level=level) < limit), MAX_UNITS)


def foresight(units: int, unit: str = "seed", *, level: float = LEVEL, margin: Margin = MARGIN) -> str:
    """What so many seeds (or worlds) will be able to tell, in a sentence or two."""
    typical, fewest = typical_seeds(level=level, margin=margin), min_values(level)
    name = unit if units == 1 else f"{unit}s"
    usual = f"about {typical} usually do" if typical > fewest else ""
    if units < fewest:
        return f"{units} {name} cannot show that a count is enough; {fewest} can" + (f", {usual}." if usual else ".")
    share = f"{100.0 * detectable_share(units, level=level):.0f} %"
    enough = (
        f"; to show that a count is enough {usual}" if units < typical else "; that usually shows which count is enough"
    )
    shown = f"{units} {name} will show a difference between two counts if it is larger than about {share} of the error"
    return f"{shown}{enough}."
