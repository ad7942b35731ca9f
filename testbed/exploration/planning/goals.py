# SPDX-License-Identifier: MIT
"""Choice of the frontier to drive to: the nearest, or the one with the largest information gain per metre."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from slam.occupancy import LOG_ODDS_LIMITS
from testbed.exploration.planning._grid_kernels import visible_sum
from testbed.exploration.planning.floor import Floor
from testbed.exploration.planning.frontiers import Frontier

GoalChoice = Callable[[Floor, list[Frontier]], Frontier]
"""Chooses one of the frontiers, of which there is at least one."""

RAYS = 180
"""Rays that find the cells visible from a goal."""
MAX_DEPTH = 5.0
"""Cells farther than this from a goal are not counted as visible, because walls are likely in between [m]."""
MIN_PATH_COST = 1.0
"""Added to the cost of each path [m]; it keeps very near, very small frontiers from winning."""


def nearest(floor: Floor, frontiers: list[Frontier]) -> Frontier:
    """Return the frontier with the cheapest path (Yamauchi 1997)."""
    del floor
    return min(frontiers, key=lambda frontier: frontier.cost)


def most_information(reach: float) -> GoalChoice:
    """Return a choice by the information gain visible from the goal per metre of path.

    reach: range of the lidar [m]. The gain is that of the filter's own map, as in Stachniss, Grisetti, Burgard,
    Information gain-based exploration using Rao-Blackwellized particle filters, RSS 2005; their second part, the gain
    in the entropy of the poses, is left out.
    """

    def choose(floor: Floor, frontiers: list[Frontier]) -> Frontier:
        gain = information_gain(floor.probability)

        def gain_per_metre(frontier: Frontier) -> float:
            visible = visible_sum(gain, floor.occupied, *frontier.goal, min(reach, MAX_DEPTH) / floor.cell, RAYS)
            return float(visible) / (frontier.cost + MIN_PATH_COST)

        return max(frontiers, key=gain_per_metre)

    return choose


def information_gain(probability: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return by how much further scans can lower the entropy of cells with this P(occupied) [nats], same shape.

    It is ln 2 for unknown cells, and 0 where the filter's map has reached the limit of its log-odds.
    """
    settled = _entropy(np.array(1.0 / (1.0 + math.exp(-LOG_ODDS_LIMITS[0]))))
    gain: NDArray[np.float64] = np.maximum(_entropy(probability.astype(np.float64)) - settled, 0.0)
    return gain


def _entropy(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    p = np.clip(probability, 1e-9, 1.0 - 1e-9)
    entropy: NDArray[np.float64] = -p * np.log(p) - (1.0 - p) * np.log(1.0 - p)
    return entropy
