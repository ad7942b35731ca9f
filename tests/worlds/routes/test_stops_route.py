# SPDX-License-Identifier: MIT
"""Routes to random stops: on all floor, away from walls, another one for each seed."""

import numpy as np
import pytest
import shapely

import worlds
from worlds import Box, Start, Tour, Wall, World, WorldError, stops_route

ROBOT = 0.22
"""Footprint and clearance of the default robot [m]."""


def route(world: World, seed: int) -> World:
    return stops_route(world, np.random.default_rng(seed), clearance=ROBOT)


def room(size: float, points: list[tuple[float, float]]) -> World:
    """A square room whose drive begins at (1, 1)."""
    outline = Wall(name="outline", points=[(0, 0), (size, 0), (size, size), (0, size)], closed=True)
    return World(name="room", start=Start(x=1.0, y=1.0), walls=[outline], tour=Tour(points=points))


@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 5), marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", [name for name in worlds.catalogue() if worlds.load(name).tour is not None])
def test_every_route_is_drivable_and_as_long_as_the_tour(name, seeds):
    world = worlds.load(name)
    length = shapely.LineString(world.path()).length
    for seed in seeds:
        drawn = route(world, seed)
        worlds.check_world(drawn, footprint_radius=ROBOT)
        assert shapely.LineString(drawn.path()).length == pytest.approx(length)


def test_stops_are_on_all_floor():
    world = room(20.0, [(19.0, 1.0)])  # the tour follows one wall
    corners = np.concatenate([route(world, seed).path() for seed in range(100)])
    counts, *_ = np.histogram2d(*corners.T, bins=4, range=[[0, 20], [0, 20]])
    assert (counts > 0).all()


def test_a_closed_room_is_not_visited():
    world = room(12.0, [(11.0, 1.0)])
    cell = Wall(name="cell", points=[(6, 6), (10, 6), (10, 10), (6, 10)], closed=True)
    world = world.model_copy(update={"walls": [*world.walls, cell], "boxes": [Box(x=3, y=8, width=2, depth=2)]})
    for seed in range(10):
        path = shapely.LineString(route(world, seed).path())
        assert not path.intersects(shapely.box(6, 6, 10, 10))
        assert path.distance(world.cross_section()) > ROBOT


def test_a_small_room_is_crossed():
    assert len(route(room(3.0, [(2.0, 1.0)]), 0).path()) >= 2


def test_the_robot_faces_along_the_first_leg():
    drawn = route(worlds.load("office"), 4)
    (x, y), (x_next, y_next) = drawn.path()[:2]
    assert drawn.start.theta == pytest.approx(np.arctan2(y_next - y, x_next - x))


def test_the_same_seed_gives_the_same_route():
    office = worlds.load("office")
    assert route(office, 5) == route(office, 5)
    assert len({tuple(route(office, seed).path()[0]) for seed in range(20)}) > 15


def test_a_world_without_a_tour_is_refused():
    with pytest.raises(WorldError, match="has no tour, expected"):
        route(worlds.load("office").model_copy(update={"tour": None}), 0)
    with pytest.raises(WorldError, match="tour has no length"):
        route(room(10.0, [(1.0, 1.0)]), 0)


def test_a_start_can_be_kept():
    office = worlds.load("office")
    for seed in range(5):
        drawn = stops_route(office, np.random.default_rng(seed), clearance=ROBOT, keep_start=True)
        assert drawn.start == office.start
        worlds.check_world(drawn, footprint_radius=ROBOT)
        assert shapely.LineString(drawn.path()).length == pytest.approx(shapely.LineString(office.path()).length)
