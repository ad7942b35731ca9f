# SPDX-License-Identifier: MIT
"""Loops that the other local maps refute.

Where a building repeats itself, two maps of different places agree as well as two of one. If the chain is uncertain
enough, nothing in the pose graph speaks against such a loop. But it bends the path between the two visits, and puts the
maps of that stretch onto walls that are not theirs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slam import se2
from slam.loops.correlative_match import SearchMap, count_walls, thinned
from slam.loops.loop import Loop, edges_of
from slam.loops.pose_graph import Edges, join, optimise

MAX_COST = 2.0
"""A loop is refuted if, without it, agreement grows by that of so many maps. In 20 drives and logs none of 35 right
loops came to more than 0.9, and a wrong one in `maze` came to 20."""
MAX_WALLS = 300
"""Walls of a map that are counted, at most."""
NEIGHBOURS = 2
"""Loops whose maps differ by at most this many numbers in both visits stand or fall together."""


def support(maps: Sequence[SearchMap], poses: se2.Pose) -> int:
    """How many walls of maps at poses (maps, 3) agree with other maps, less those that contradict them."""
    few = [thinned(seen, MAX_WALLS) for seen in maps]
    reach = np.array([seen.reach for seen in maps])
    total = 0
    for i in range(len(maps)):
        apart = np.hypot(*(poses[i + 1 :, :2] - poses[i, :2]).T)
        for j in (i + 1 + np.flatnonzero(apart < reach[i] + reach[i + 1 :])).tolist():
            there = se2.between(poses[i], poses[j])
            for agree, contradict in (
                count_walls(maps[i], few[j], there),
                count_walls(maps[j], few[i], se2.inverse(there)),
            ):
                total += agree - contradict
    return total


def refuted_loops(maps: Sequence[SearchMap], poses: se2.Pose, chain: Edges, loops: Sequence[Loop]) -> list[int]:
    """Numbers of the loops that the maps refute most, which join the same two places; none where all stand.

    poses (maps, 3): the optimum of the chain and the loops. Loops that the given path had closed are not in question.
    """
    costs: dict[tuple[int, ...], float] = {}
    begin = None
    for loop in loops:
        group = tuple(k for k, other in enumerate(loops) if _joins_the_same(loop, other))
        if loop.was_closed or group in costs:
            continue
        rest = join(chain, edges_of([other for k, other in enumerate(loops) if k not in group]))
        begin = support(maps, poses) if begin is None else begin
        without = support(maps, optimise(poses, rest, np.ones(len(rest.first))))
        costs[group] = (without - begin) * len(maps) / max(without, 1)
    worst = max(costs, key=lambda group: costs[group], default=())
    return list(worst) if worst and costs[worst] > MAX_COST else []


def _joins_the_same(loop: Loop, other: Loop) -> bool:
    """Whether two loops that the path had left open join the same two places."""
    apart = max(abs(loop.first - other.first), abs(loop.second - other.second))
    return apart <= NEIGHBOURS and loop.was_closed == other.was_closed
