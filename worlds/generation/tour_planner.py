# SPDX-License-Identifier: MIT
"""Plan a tour for a world without one, such as a floor plan: through all floor that the robot can reach, and back."""

from __future__ import annotations

import math
from collections.abc import Callable
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
"""Side of the cells in which paths are searched [m]."""
_MARGIN = 1.5 * _CELL
"""Legs deviate from cell centres by up to 0.5 cells, surfaces from the centres of their cells by up to 0.71 [m]."""
_PREFERRED_CLEARANCE = 0.5
"""Distance from walls that paths keep where there is room [m]."""
_MAX_COST = 3.0
"""Cost of a step next to a wall, relative to one in the open."""
_REACH = 3.0
"""Floor counts as visited when the tour has passed it at this walking distance [m]."""


def plan_tour(world: World, *, footprint_radius: float, progress: Callable[[float], None] | None = None) -> World:
    """Return the world with a tour: always to the nearest floor not yet visited, and back to the start at the end.

    footprint_radius: all legs keep more than this distance from all surfaces [m]. Floor behind narrower gaps is not
    visited. The same world gets the same tour. progress: called with the visited share of the floor after each leg, 0
    to 1. Raises `WorldError` if the start has no room for the robot, or if no other floor can be reached.
    """
    graph = _FloorGraph(world, footprint_radius)
    unvisited = np.ones(len(graph.centres), dtype=np.bool_)
    here, legs = graph.start, [[graph.start]]
    while True:
        unvisited &= np.isinf(graph.costs(legs[-1], limit=_REACH))
        if progress is not None:
            progress(1.0 - float(unvisited.mean()))
        leg = graph.to_nearest(here, unvisited)
        if leg is None:
            break
        legs.append(leg)
        here = leg[-1]
    if len(legs) == 1:
        raise WorldError(f"world {world.name!r}: no floor can be reached from the start, expected floor for a tour")
    home = np.zeros_like(unvisited)
    home[graph.start] = True
    legs.append(graph.to_nearest(here, home) or [])
    points = [point for leg in legs[1:] for point in graph.corners(leg)]
    return world.model_copy(update={"tour": Tour(points=[b for a, b in pairwise([None, *points]) if b and a != b])})


class _FloorGraph:
    """The cells in which the robot's centre can be, as a graph whose edges lead to the eight neighbours."""

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
                f"world {world.name!r}: start ({world.start.x:g}, {world.start.y:g}) m is closer than "
                f"{footprint_radius + _MARGIN:.2f} m to a wall, expected more room for planning a tour"
            )
        number = np.full(labels.shape, -1)
        inside = labels == labels[row, col]
        number[inside] = np.arange(inside.sum())
        self.start = int(number[row, col])
        self.centres = (np.argwhere(inside)[:, ::-1] + 0.5) * _CELL + np.array(floor.origin[:2])
        """Centres of the cells [m], (cells, 2)."""
        self._graph = _neighbours(number, np.interp(distance, [0.0, _PREFERRED_CLEARANCE], [_MAX_COST, 1.0]))

    def costs(self, sources: list[int], *, limit: float) -> NDArray[np.float64]:
        """Return the cost [m] of the cheapest path from any source to each cell, (cells,); inf beyond the limit."""
        found: NDArray[np.float64] = dijkstra(self._graph, indices=sources, limit=limit, min_only=True)
        return found

    def to_nearest(self, source: int, goals: NDArray[np.bool_]) -> list[int] | None:
        """Return the cheapest path from a cell to any goal, both ends included; None if there are no goals."""
        if not goals.any():
            return None
        for limit in (4.0 * _REACH, np.inf):  # the next goal is usually near
            cost, before = dijkstra(self._graph, indices=[source], limit=limit, return_predecessors=True)
            cost = np.where(goals, cost[0], np.inf)
            if np.isfinite(cost.min()):
                break
        path = [int(np.argmin(cost))]
        while path[-1] != source:
            path.append(int(before[0, path[-1]]))
        return path[::-1]

    def corners(self, path: list[int]) -> list[tuple[float, float]]:
        """Return way points [m] along a path of cells, never more than half a cell away from it."""
        if len(path) < 2:
            return []
        line = shapely.simplify(LineString(self.centres[path]), 0.5 * _CELL, preserve_topology=False)
        return [(round(x, 3), round(y, 3)) for x, y in shapely.get_coordinates(line)[1:].tolist()]


def _neighbours(number: NDArray[np.intp], cost: NDArray[np.float64]) -> sparse.csr_matrix:
    """Return the costs [m] between neighbouring cells; `number` (rows, cols) is their index, and -1 elsewhere."""
    rows, cols = number.shape
    begins, ends, costs = [], [], []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = np.s_[: rows - down, max(0, -right) : cols - max(0, right)]
        b = np.s_[down:, max(0, right) : cols + min(0, right)]
        both = (number[a] >= 0) & (number[b] >= 0)
        begins.append(number[a][both])
        ends.append(number[b][both])
        costs.append(_CELL * math.hypot(down, right) * 0.5 * (cost[a] + cost[b])[both])
    cells = int(number.max()) + 1
    edges = (np.concatenate(costs), (np.concatenate(begins), np.concatenate(ends)))
    one_way = sparse.csr_matrix(edges, shape=(cells, cells))
    return sparse.csr_matrix(one_way + one_way.T)
