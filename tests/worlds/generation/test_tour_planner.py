# SPDX-License-Identifier: MIT
"""Planned tours: drivable, through all floor within reach, home at the end."""

import numpy as np
import pytest
import shapely

import worlds
from worlds import Box, Start, Wall, World, plan_tour

RADIUS = 0.25


def bare(world: World) -> World:
    return world.model_copy(update={"tour": None})


def room(*boxes: Box, start: tuple[float, float] = (1.0, 1.0)) -> World:
    """A room of 8 m x 4 m."""
    corners = [(0.0, 0.0), (8.0, 0.0), (8.0, 4.0), (0.0, 4.0)]
    outline = Wall(name="outline", points=corners, closed=True)
    return World(name="room", start=Start(x=start[0], y=start[1]), walls=[outline], boxes=list(boxes))


def divided(gap: float) -> World:
    """That room with a wall across its middle that leaves a gap [m]."""
    low, high = 2.0 - gap / 2.0, 2.0 + gap / 2.0
    return room(
        Box(name="below", x=4.0, y=low / 2.0, width=0.2, depth=low),
        Box(name="above", x=4.0, y=(4.0 + high) / 2.0, width=0.2, depth=4.0 - high),
    )


@pytest.mark.parametrize("name", ["office", "loop", "apartment", "museum", "maze"])
def test_a_tour_is_drivable_complete_and_closed(name):
    world = plan_tour(bare(worlds.load(name)), footprint_radius=RADIUS)
    worlds.check_world(world, footprint_radius=RADIUS)
    path = shapely.LineString(world.path())
    assert np.hypot(*(world.path()[-1] - world.path()[0])) < 0.1
    roomy = max(shapely.get_parts(world.free_space().buffer(-0.5)), key=lambda part: part.area)
    assert roomy.difference(path.buffer(3.1)).is_empty  # 3 m of way, to the middle of a cell


def test_the_same_world_gets_the_same_tour():
    first, second = (plan_tour(bare(worlds.load("lab")), footprint_radius=RADIUS) for _ in range(2))
    assert first == second


@pytest.mark.parametrize(("gap", "crossed"), [(1.2, True), (0.6, False)])
def test_a_gap_is_crossed_if_the_robot_fits_with_a_margin(gap, crossed):
    world = plan_tour(divided(gap), footprint_radius=RADIUS)
    worlds.check_world(world, footprint_radius=RADIUS)
    assert bool((world.path()[:, 0] > 4.2).any()) == crossed


def test_a_start_without_room_is_refused():
    with pytest.raises(worlds.WorldError, match=r"world 'room': start \(0.3, 1\) m is closer than 0.40 m to a wall"):
        plan_tour(room(start=(0.3, 1.0)), footprint_radius=RADIUS)


def test_nowhere_to_go_is_refused():
    cell = Wall(name="outline", points=[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)], closed=True)
    with pytest.raises(worlds.WorldError, match="no floor can be reached"):
        plan_tour(World(name="cell", start=Start(x=0.5, y=0.5), walls=[cell]), footprint_radius=RADIUS)


def test_planning_reports_the_visited_share():
    world = worlds.load("office").model_copy(update={"tour": None})
    shares = []
    planned = worlds.plan_tour(world, footprint_radius=0.2, progress=shares.append)
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < shares[-1] == 1.0
    assert planned == worlds.plan_tour(world, footprint_radius=0.2)
