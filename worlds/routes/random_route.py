# SPDX-License-Identifier: MIT
"""Draws a route at random: every leg of the world's tour is driven, in random order and direction, from a random start.

The tour becomes a graph whose nodes are its corners and crossings, and the route is a random walk that uses every edge
as often as the tour does (an Eulerian trail, found by Hierholzer's algorithm). So each route passes all the floor that
the tour passes, closes all of its loops, and keeps the tour's distance from walls.
"""

from __future__ import annotations

import math
from collections import Counter
from itertools import combinations, pairwise

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray

from worlds.errors import WorldError
from worlds.world import Start, Tour, World

_GRID = 1e-3
"""Corners and crossings are rounded to this [m]."""
_MIN_EDGE = 0.2
"""A start this close to a corner is moved to the corner: shorter edges would make the robot turn for nothing [m]."""
Edge = tuple[int, int]


def random_route(world: World, rng: Generator) -> World:
    """The world with another start and tour: the whole tour in random order and direction from a random start.

    The start is uniform along the tour, and the robot faces along the first leg. The route is as long as the tour if
    the tour ends where it began; otherwise some legs are driven once more to reach one of its ends. The same state of
    `rng` gives the same route. Raises `WorldError` if the world has no tour.
    """
    if world.tour is None:
        raise WorldError(f"world {world.name!r} has no tour, expected [tour] with way points to draw a route from")
    graph = _Graph(world.path())
    start = graph.draw_start(rng)
    graph.make_traversable(start)
    points = _without_straight_corners(graph.positions[graph.draw_trail(start, rng)])
    (x, y), (x_next, y_next) = points[0].tolist(), points[1].tolist()
    return world.model_copy(
        update={
            "start": Start(x=x, y=y, theta=math.atan2(y_next - y, x_next - x)),
            "tour": Tour(points=[(x, y) for x, y in points[1:].tolist()]),
            "difficulty": None,
        }
    )


class _Graph:
    """Corners and crossings of a path, and the pieces of it between them, each with how often the path uses it."""

    def __init__(self, path: NDArray[np.float64]) -> None:
        """path: corners (n, 2) [m]."""
        legs = np.array([shapely.LineString(leg) for leg in pairwise(path)])
        legs = legs[shapely.length(legs) > _GRID]
        if len(legs) == 0:
            raise WorldError("the tour has no length, expected way points away from the start")
        numbers: dict[tuple[float, float], int] = {}
        self.uses: Counter[Edge] = Counter()
        """How often each edge is to be driven."""
        tree = shapely.STRtree(legs)
        for line in shapely.get_parts(shapely.union_all(legs, grid_size=_GRID)):
            for a, b in pairwise(shapely.get_coordinates(line).round(6).tolist()):
                middle = shapely.Point(0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]))
                edge = sorted(numbers.setdefault((x, y), len(numbers)) for x, y in (a, b))
                self.uses[edge[0], edge[1]] = max(1, len(tree.query(middle, "dwithin", 3.0 * _GRID)))
        self.positions = np.array(list(numbers), dtype=np.float64)
        """(nodes, 2) [m]."""

    def draw_start(self, rng: Generator) -> int:
        """A node at a position that is uniform along the edges; an edge is split for it."""
        edges = sorted(self.uses)
        lengths = np.array([self._length(edge) for edge in edges])
        a, b = edges[int(rng.choice(len(edges), p=lengths / lengths.sum()))]
        length, along = self._length((a, b)), rng.uniform()
        if along * length < _MIN_EDGE:
            return a
        if (1.0 - along) * length < _MIN_EDGE:
            return b
        node = len(self.positions)
        position = (1.0 - along) * self.positions[a] + along * self.positions[b]
        self.positions = np.vstack([self.positions, position.round(3)])
        uses = self.uses.pop((a, b))
        self.uses[a, node] = self.uses[b, node] = uses
        return node

    def make_traversable(self, start: int) -> None:
        """Use edges once more until a trail from `start` can use all of them: at most one other node may be odd.

        Nodes of odd degree are paired along the shortest ways, the nearest pair first.
        """
        from scipy import sparse  # here: its import takes a tenth of the start of `testbed simulate`
        from scipy.sparse.csgraph import dijkstra

        degree: Counter[int] = Counter()
        for (a, b), uses in self.uses.items():
            degree[a] += uses
            degree[b] += uses
        odd = sorted({node for node, count in degree.items() if count % 2} ^ {start})
        if len(odd) == 1:
            return
        edges = list(self.uses)
        nodes = len(self.positions)
        weights = sparse.csr_matrix(
            ([self._length(edge) for edge in edges], tuple(np.transpose(edges))), shape=(nodes, nodes)
        )
        distance, before = dijkstra(weights, directed=False, indices=odd, return_predecessors=True)
        row = {node: k for k, node in enumerate(odd)}
        while len(odd) > 1:
            a, b = min(combinations(odd, 2), key=lambda pair: float(distance[row[pair[0]], pair[1]]))
            here = b
            while here != a:
                previous = int(before[row[a], here])
                self.uses[min(here, previous), max(here, previous)] += 1
                here = previous
            odd = [node for node in odd if node not in (a, b)]

    def draw_trail(self, start: int, rng: Generator) -> list[int]:
        """Nodes of a random trail from `start` that drives every edge as often as it is to be used.

        Where there is a choice the robot does not turn round on the spot.
        """
        left = Counter(self.uses)
        neighbours: dict[int, list[int]] = {}
        for a, b in sorted(left):
            neighbours.setdefault(a, []).append(b)
            neighbours.setdefault(b, []).append(a)
        stack, trail = [start], []
        while stack:
            here = stack[-1]
            choices = [node for node in neighbours[here] if left[min(here, node), max(here, node)]]
            if not choices:
                trail.append(stack.pop())
                continue
            onward = [node for node in choices if node != stack[-2]] if len(stack) > 1 else choices
            node = (onward or choices)[int(rng.integers(len(onward or choices)))]
            left[min(here, node), max(here, node)] -= 1
            stack.append(node)
        return trail[::-1]

    def _length(self, edge: Edge) -> float:
        return float(np.hypot(*(self.positions[edge[1]] - self.positions[edge[0]])))


def _without_straight_corners(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (n, 2) without those at which the path goes straight on."""
    before, after = points[1:-1] - points[:-2], points[2:] - points[1:-1]
    across = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    forward = (before * after).sum(axis=1) > 0.0
    straight = forward & (np.abs(across) <= 2.0 * _GRID * np.hypot(before[:, 0], before[:, 1]))
    kept: NDArray[np.float64] = points[np.concatenate([[True], ~straight, [True]])]
    return kept
