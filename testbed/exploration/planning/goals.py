# SPDX-License-Identifier: MIT
"""Which frontier to drive to: the nearest, or the one that promises most news for its way."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from slam.grid.particle_maps import LOG_ODDS_LIMITS
from testbed.exploration.planning._grid_kernels import visible_sum
from testbed.exploration.planning.floor import Floor
from testbed.exploration.planning.frontiers import Frontier

GoalChoice = Callable[[Floor, list[Frontier]], Frontier]
"""Chooses one of the frontiers, of which there is at least one."""

RAYS = 180
"""By which what a goal shows is counted."""
FARTHEST = 5.0
"""What lies behind so much of the unknown [m] is not counted: walls are likely on the way."""
START_UP = 1.0
"""Added to the length of each way [m]: without it the robot would pick crumbs at its feet."""


def nearest(floor: Floor, frontiers: list[Frontier]) -> Frontier:
    """The frontier whose way is the cheapest (Yamauchi 1997)."""
    del floor
    return min(frontiers, key=lambda frontier: frontier.cost)


def information_gain(reach: float) -> GoalChoice:
    """Chooses by what can be learned in sight of the goal per metre of way; `reach` of the lidar [m].

    Entropy of the filter's own map, as in Stachniss, Grisetti, Burgard, Information gain-based exploration using
    Rao-Blackwellized particle filters, RSS 2005; without their second part, the gain in the poses' entropy.
    """

    def choose(floor: Floor, frontiers: list[Frontier]) -> Frontier:
        news = learnable(floor.probability)

        def gain_per_metre(frontier: Frontier) -> float:
            gain = visible_sum(news, floor.occupied, *frontier.goal, min(reach, FARTHEST) / floor.cell, RAYS)
            return float(gain) / (frontier.cost + START_UP)

        return max(frontiers, key=gain_per_metre)

    return choose


def learnable(probability: NDArray[np.float32]) -> NDArray[np.float64]:
    """What further scans can take from the entropy of cells with that P(occupied) [nats].

    All where nothing is known (ln 2), nothing where the filter's map has reached the limit of its log-odds.
    """
    settled = _entropy(np.array(1.0 / (1.0 + math.exp(-LOG_ODDS_LIMITS[0]))))
    news: NDArray[np.float64] = np.maximum(_entropy(probability.astype(np.float64)) - settled, 0.0)
    return news


def _entropy(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    p = np.clip(probability, 1e-9, 1.0 - 1e-9)
    entropy: NDArray[np.float64] = -p * np.log(p) - (1.0 - p) * np.log(1.0 - p)
    return entropy
