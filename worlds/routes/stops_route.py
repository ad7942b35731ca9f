# SPDX-License-Identifier: MIT
"""Draws a route to random stops on all floor, so that two drives through a world have little of their way in common.

Places are drawn on the floor and joined by straight legs that keep away from walls, also to the corners of the world's
tour, which leads through narrow doors (a probabilistic roadmap, Kavraki et al. 1996). Some of the places are stops. The
robot drives to one of the nearest stops that it has not visited, chosen at random, until it has driven as far as the
tour is long.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import KDTree
from shapely.geometry.base import BaseGeometry

from worlds.errors import WorldError
from worlds.movers import PERSON_CLEARANCE
from worlds.world import Start, Tour, World, segments_of, surface_of

_MARGIN = 0.1
"""Legs off the tour keep this much more from walls than the tour must: pure pursuit cuts their corners [m]."""
_AREA_OF_PLACE, _MAX_PLACES = 1.0, 4000
"""A place is drawn for each such piece of the world's extent [m²], up to this number."""
_NEIGHBOURS = 10
"""Each place is joined to this many of the nearest ones, where the way is free."""
_STOP_DISTANCE = 2.5
"""Stops are at least this far from each other [m]."""
_NEAR = 10.0
"""Distance within which stops are searched first [m]."""
_CHOICES = 3
"""The next stop is one of this many of the nearest ones."""

Floats = NDArray[np.float64]


def stops_route(world: World, rng: Generator, *, clearance: float) -> World:
    """Return the world with a random start and a tour to random stops, as long as the world's own tour.

    clearance: least distance of the tour from walls, measured from the centre of the robot [m]. The same state of `rng`
    gives the same route. Raises `WorldError` if the world has no tour, or a tour without length.
    """
    if world.tour is None:
        raise WorldError(f"world {world.name!r} has no tour, expected [tour] with way points to draw a route from")
    path = world.path()
    length = float(np.hypot(*np.diff(path, axis=0).T).sum())
    if length == 0.0:
        raise WorldError("the tour has no length, expected way points away from the start")
    roadmap = _Roadmap(world, path, clearance + _MARGIN, rng)
    points = roadmap.draw_route(length, rng)
    (x, y), (x_next, y_next) = points[0].tolist(), points[1].tolist()
    return world.model_copy(
        update={
            "start": Start(x=x, y=y, theta=math.atan2(y_next - y, x_next - x)),
            "tour": Tour(points=[(x, y) for x, y in points[1:].tolist()]),
            "difficulty": None,
        }
    )


class _Roadmap:
    """Corners of the tour and random places, with the free straight legs between them."""

    def __init__(self, world: World, tour: Floats, clearance: float, rng: Generator) -> None:
        """tour: corners (n, 2) [m];  clearance: of the legs that are not part of the tour [m]."""
        solid = world.cross_section()
        waiting = [end for person in world.people for end in (person.points[0], person.points[-1])]
        self._obstacles = shapely.STRtree(
            [
                *np.asarray(shapely.linestrings(segments_of(surface_of(solid)).reshape(-1, 2, 2))),
                *(shapely.Point(end).buffer(PERSON_CLEARANCE) for end in waiting),
                *(door.open_leaf() for door in world.doors),
            ]
        )
        self._clearance = clearance
        corners = np.unique(tour.round(6), axis=0)
        number = {(x, y): k for k, (x, y) in enumerate(corners.tolist())}
        on_tour = {tuple(sorted((number[a], number[b]))) for a, b in pairwise(map(tuple, tour.round(6).tolist()))}
        places = self._draw_places(solid, tour, rng)
        self.positions = np.vstack([corners, places])
        """(nodes, 2) [m]."""
        legs = self._near_pairs()
        legs = legs[self._is_free(self.positions[legs[:, 0]], self.positions[legs[:, 1]])]
        legs = np.unique(np.vstack([legs, [leg for leg in sorted(on_tour) if leg[0] != leg[1]]]), axis=0)
        nodes, lengths = len(self.positions), np.hypot(*(self.positions[legs[:, 1]] - self.positions[legs[:, 0]]).T)
        one_way = sparse.csr_matrix((lengths, (legs[:, 0], legs[:, 1])), shape=(nodes, nodes))
        self._graph = sparse.csr_matrix(one_way + one_way.T)
        labels = connected_components(self._graph, directed=False)[1]
        self._reachable = labels == labels[number[tour[0].round(6)[0], tour[0].round(6)[1]]]

    def draw_route(self, length: float, rng: Generator) -> Floats:
        """Corners (n, 2) [m] of a route of this length [m]."""
        stops = self._draw_stops(rng)
        here = stops[0]
        unvisited = set(stops[1:])
        points, driven = [self.positions[here]], 0.0
        while driven < length:
            unvisited = unvisited or set(stops) - {here}
            for limit in (_NEAR, np.inf):  # the next stops are usually near
                cost, before = dijkstra(self._graph, indices=[here], return_predecessors=True, limit=limit)
                nearest = sorted((c, stop) for stop in unvisited if np.isfinite(c := cost[0, stop]))[:_CHOICES]
                if len(nearest) == min(_CHOICES, len(unvisited)):
                    break
            _, there = nearest[int(rng.integers(len(nearest)))]
            way = [there]
            while way[-1] != here:
                way.append(int(before[0, way[-1]]))
            leg = self._straightened(self.positions[way[::-1]])
            driven += float(np.hypot(*np.diff(leg, axis=0).T).sum())
            points.extend(leg[1:])
            unvisited.discard(there)
            here = there
        last, too_long = points[-1] - points[-2], driven - length
        while too_long > (step := float(np.hypot(*last))):  # the route ends on the way to the last stop
            points.pop()
            last, too_long = points[-1] - points[-2], too_long - step
        points[-1] = points[-1] - last * too_long / step
        return np.array(points)

    def _draw_places(self, solid: BaseGeometry, tour: Floats, rng: Generator) -> Floats:
        """Random places off all surfaces (n, 2) [m]; some may lie outside of the world's outline."""
        bounds = np.array([*shapely.bounds(solid)] if not solid.is_empty else [*tour.min(axis=0), *tour.max(axis=0)])
        size = bounds[2:] - bounds[:2]
        count = min(max(int(size.prod() / _AREA_OF_PLACE), 1), _MAX_PLACES)
        places = (bounds[:2] + size * rng.uniform(size=(count, 2))).round(3)
        shapely.prepare(solid)
        inside = np.asarray(shapely.contains_properly(solid, shapely.points(places)))
        found: Floats = places[self._is_free(places, places) & ~inside]
        return found

    def _near_pairs(self) -> NDArray[np.int64]:
        """Pairs of neighbours (n, 2), the smaller number first."""
        near = np.asarray(KDTree(self.positions).query(self.positions, k=min(_NEIGHBOURS + 1, len(self.positions)))[1])
        pairs = np.column_stack([np.repeat(near[:, 0], near.shape[1] - 1), near[:, 1:].ravel()])
        found: NDArray[np.int64] = np.unique(np.sort(pairs, axis=1), axis=0)
        return found

    def _is_free(self, begins: Floats, ends: Floats) -> NDArray[np.bool_]:
        """Tell of straight legs between points (n, 2) [m] whether they keep the clearance."""
        lines = np.asarray(shapely.linestrings(np.stack([begins, ends], axis=1)))
        free = np.ones(len(lines), dtype=np.bool_)
        free[self._obstacles.query(lines, "dwithin", self._clearance)[0]] = False
        return free

    def _draw_stops(self, rng: Generator) -> list[int]:
        """Places to visit, spread over the floor."""
        possible = np.flatnonzero(self._reachable)
        stops: list[int] = []
        for node in rng.permutation(possible).tolist():
            if all(np.hypot(*(self.positions[stops] - self.positions[node]).T) >= _STOP_DISTANCE):
                stops.append(node)
        if len(stops) == 1:  # a small room: drive to its far end
            apart = np.hypot(*(self.positions[possible] - self.positions[stops[0]]).T)
            stops.append(int(possible[np.argmax(apart)]))
        return stops

    def _straightened(self, way: Floats) -> Floats:
        """The corners of a way (n, 2) [m] without those that a free straight leg can leave out."""
        kept, here = [way[0]], 0
        while here < len(way) - 1:
            ahead = np.arange(here + 1, len(way))
            free = self._is_free(np.broadcast_to(way[here], (len(ahead), 2)), way[ahead])
            free[0] = True  # a leg of the roadmap
            here = int(ahead[free][-1])
            kept.append(way[here])
        return np.array(kept)
