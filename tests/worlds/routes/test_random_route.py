# SPDX-License-Identifier: MIT
"""Random routes: all of the tour, as far from walls, another one for each seed."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
import shapely

import worlds
from worlds import Start, Tour, Wall, World, WorldError, random_route

ROBOT = 0.22
"""Footprint and clearance of the default robot [m]."""


def route(world: World, seed: int) -> World:
    return random_route(world, np.random.default_rng(seed))


def hall(points: list[tuple[float, float]], **tour: object) -> World:
    """A hall of 20 m x 20 m with a tour from (2, 2)."""
    corners = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)]
    outline = Wall(name="outline", points=corners, closed=True)
    return World(name="hall", start=Start(x=2.0, y=2.0), walls=[outline], tour=Tour(points=points, **tour))


def turns_round(world: World) -> int:
    """How often the robot drives back the way it came."""
    steps = np.diff(world.path(), axis=0)
    steps /= np.hypot(steps[:, 0], steps[:, 1])[:, None]
    return int(((steps[1:] * steps[:-1]).sum(axis=1) < -0.99).sum())


@pytest.mark.parametrize("name", [name for name in worlds.catalogue() if worlds.load(name).tour is not None])
def test_every_route_passes_the_whole_tour_and_is_drivable(name):
    world = worlds.load(name)
    tour = shapely.LineString(world.path())
    for seed in range(5):
        drawn = route(world, seed)
        worlds.check_world(drawn, footprint_radius=ROBOT)
        driven = shapely.LineString(drawn.path())
        assert shapely.hausdorff_distance(driven, tour) < 0.01
        assert tour.length - 0.1 < driven.length < 1.3 * tour.length


def test_starts_differ_and_spread_over_the_tour():
    square = hall([(18.0, 2.0), (18.0, 18.0), (2.0, 18.0), (2.0, 2.0)])
    tour = shapely.LineString(square.path())
    at = [tour.project(shapely.Point(drawn.start.x, drawn.start.y)) for drawn in (route(square, s) for s in range(200))]
    counts, _ = np.histogram(at, bins=4, range=(0.0, tour.length))
    assert (counts > 30).all()  # 50 expected in each quarter, 6.1 its standard deviation


def test_both_directions_of_a_loop_are_driven():
    square = hall([(18.0, 2.0), (18.0, 18.0), (2.0, 18.0), (2.0, 2.0)])
    senses = Counter(
        np.sign(shapely.LinearRing(drawn.path()).is_ccw - 0.5) for drawn in (route(square, s) for s in range(100))
    )
    assert min(senses[-1.0], senses[1.0]) > 30
    assert all(turns_round(route(square, seed)) == 0 for seed in range(20))


def test_every_piece_is_driven_as_often_as_in_the_tour():
    laps = hall([(2.0, 2.0), (18.0, 2.0), (18.0, 18.0), (2.0, 18.0)], closed=True, laps=3)
    for seed in range(10):
        path = route(laps, seed).path()
        legs = [shapely.LineString(leg) for leg in pairwise(path)]
        for point in ((10.0, 2.0), (18.0, 10.0), (10.0, 18.0), (2.0, 10.0)):
            passes = sum(leg.distance(shapely.Point(point)) < 1e-6 for leg in legs)
            assert passes == 3
        assert turns_round(route(laps, seed)) == 0


def test_rooms_along_a_corridor_are_visited_in_different_orders():
    doors = [4.0, 8.0, 12.0, 16.0]
    points = [point for x in doors for point in ((x, 2.0), (x, 8.0), (x, 2.0))]
    world = hall([*points, (2.0, 2.0)])

    def order(seed):
        return tuple(x for x, y in route(world, seed).path().tolist() if y == 8.0)

    orders = {order(seed) for seed in range(40)}
    assert all(set(visited) == set(doors) for visited in orders)
    assert len(orders) > 5


def test_a_tour_that_ends_elsewhere_is_driven_from_anywhere():
    world = hall([(18.0, 2.0), (18.0, 18.0)])
    for seed in range(20):
        path = route(world, seed).path()
        assert shapely.hausdorff_distance(shapely.LineString(path), shapely.LineString(world.path())) < 1e-6
        end = path[-1].tolist()
        assert end in ([2.0, 2.0], [18.0, 18.0])


def test_a_crossing_is_a_place_to_turn_off():
    eight = hall([(18.0, 18.0), (18.0, 2.0), (2.0, 18.0), (2.0, 2.0)])
    middle = [any(np.allclose(corner, 10.0, atol=0.01) for corner in route(eight, s).path()[1:-1]) for s in range(30)]
    assert any(middle)
    assert not all(middle)


def test_the_same_seed_gives_the_same_route():
    museum = worlds.load("museum")
    assert route(museum, 5) == route(museum, 5)
    assert route(museum, 5) != route(museum, 6)


def test_a_world_without_a_tour_is_refused():
    bare = worlds.load("office").model_copy(update={"tour": None})
    with pytest.raises(WorldError, match="has no tour, expected"):
        route(bare, 0)
    with pytest.raises(WorldError, match="tour has no length"):
        route(hall([(2.0, 2.0)]), 0)
