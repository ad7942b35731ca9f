# SPDX-License-Identifier: MIT
"""A tour for a world that has none, such as a floor plan: through all floor that the robot can reach, and back."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra
from shapely.geometry import LineString

from worlds.errors import WorldError
from worlds.raster import true_map
from worlds.world import Tour, World

_CELL = 0.1
"""Side of the cells in which ways are searched [m]."""
_MARGIN = 1.5 * _CELL
"""A leg strays from the middles of cells by half a cell, a surface from the middle of its cell by 0.71 cells [m]."""
_ROOMY = 0.5
"""Ways keep this distance from walls where they can [m]."""
_DEAREST = 3.0
"""What a step beside a wall costs, compared with one in the open."""
_REACH = 3.0
"""Floor is visited when the tour has passed it at that walking distance [m]."""


def plan_tour(world: World, *, footprint_radius: float) -> World:
    """The world with a tour from its start: to the nearest floor not visited yet, again and again, and home at the end.

    footprint_radius: all legs keep more than this distance from all surfaces [m]. Floor behind gaps that are too
    narrow for that is not visited. The same world gets the same tour. Raises `WorldError` if the start has no room
    for the robot, or if there is nowhere to go.
    """
    ways = _Ways(world, footprint_radius)
    unvisited = np.ones(len(ways.middles), dtype=np.bool_)
    here, legs = ways.start, [[ways.start]]
    while True:
        unvisited &= np.isinf(ways.costs(legs[-1], limit=_REACH))
        leg = ways.to_nearest(here, unvisited)
        if leg is None:
            break
        legs.append(leg)
        here = leg[-1]
    if len(legs) == 1:
        raise WorldError(f"world {world.name!r}: nowhere to go from the start, expected floor for a tour")
    home = np.zeros_like(unvisited)
    home[ways.start] = True
    legs.append(ways.to_nearest(here, home) or [])
    points = [point for leg in legs[1:] for point in ways.corners(leg)]
    return world.model_copy(update={"tour": Tour(points=[b for a, b in pairwise([None, *points]) if b and a != b])})


class _Ways:
    """The cells that the robot's centre can be in, as a graph whose edges lead to the eight neighbours."""

    def __init__(self, world: World, footprint_radius: float) -> None:
        floor = true_map(world, _CELL)
        distance = ndimage.distance_transform_edt(floor.free) * _CELL
        labels, _ = ndimage.label(distance > footprint_radius + _MARGIN, np.ones((3, 3)))
        row, col = (
            math.floor((value - low) / _CELL)
            for value, low in zip((world.start.y, world.start.x), (floor.origin[1], floor.origin[0]), strict=True)
        )
        if labels[row, col] == 0:
            raise WorldError(
                f"world {world.name!r}: start ({world.start.x:g}, {world.start.y:g}) m has not the "
                f"{footprint_radius + _MARGIN:.2f} m about it that planning a tour takes, expected a roomier place"
            )
        number = np.full(labels.shape, -1)
        inside = labels == labels[row, col]
        number[inside] = np.arange(inside.sum())
        self.start = int(number[row, col])
        self.middles = (np.argwhere(inside)[:, ::-1] + 0.5) * _CELL + np.array(floor.origin[:2])
        """(cells, 2) [m]."""
        self._graph = _neighbours(number, np.interp(distance, [0.0, _ROOMY], [_DEAREST, 1.0]))

    def costs(self, sources: list[int], *, limit: float) -> NDArray[np.float64]:
        """Cost [m] of the cheapest way from any of the cells to each one, (cells,); inf beyond the limit."""
        found: NDArray[np.float64] = dijkstra(self._graph, indices=sources, limit=limit, min_only=True)
        return found

    def to_nearest(self, source: int, goals: NDArray[np.bool_]) -> list[int] | None:
        """The cheapest way from a cell to any of the goals, both ends included; None if there are no goals."""
        if not goals.any():
            return None
        for limit in (4.0 * _REACH, np.inf):  # mostly the next goal is near
            cost, before = dijkstra(self._graph, indices=[source], limit=limit, return_predecessors=True)
            cost = np.where(goals, cost[0], np.inf)
            if np.isfinite(cost.min()):
                break
        way = [int(np.argmin(cost))]
        while way[-1] != source:
            way.append(int(before[0, way[-1]]))
        return way[::-1]

    def corners(self, way: list[int]) -> list[tuple[float, float]]:
        """Way points [m] that lead along a way, never more than half a cell beside it."""
        if len(way) < 2:
            return []
        line = shapely.simplify(LineString(self.middles[way]), 0.5 * _CELL, preserve_topology=False)
        return [(round(x, 3), round(y, 3)) for x, y in shapely.get_coordinates(line)[1:].tolist()]


def _neighbours(number: NDArray[np.intp], dearness: NDArray[np.float64]) -> sparse.csr_matrix:
    """Costs [m] between neighbouring cells; `number` (rows, cols) counts them and is -1 elsewhere."""
    rows, cols = number.shape
    begins, ends, costs = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = np.s_[: rows - down, max(0, -right) : cols - max(0, right)]
        b = np.s_[down:, max(0, right) : cols + min(0, right)]
        both = (number[a] >= 0) & (number[b] >= 0)
        begins.append(number[a][both])
        ends.append(number[b][both])
        costs.append(_CELL * math.hypot(down, right) * 0.5 * (dearness[a] + dearness[b])[both])
    cells = int(number.max()) + 1
    edges = (np.concatenate(costs), (np.concatenate(begins), np.concatenate(ends)))
    one_way = sparse.csr_matrix(edges, shape=(cells, cells))
    return sparse.csr_matrix(one_way + one_way.T)
