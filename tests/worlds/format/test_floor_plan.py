# SPDX-License-Identifier: MIT
"""Floor plans: the edges of a world enclose exactly the free cells."""

import time

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import worlds
from tests.worlds.format.plans import p5, write
from worlds.format.floor_plan import edge_loops, import_map, world_from_grid


@given(hnp.arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9))))
@settings(max_examples=150, deadline=None)
def test_edges_enclose_exactly_the_free_cells(occupied):
    """The even-odd rule over all loops gives each cell back."""
    loops = [shapely.Polygon(loop) for loop in edge_loops(occupied)]
    for row, col in np.ndindex(occupied.shape):
        middle = shapely.Point(col + 0.5, row + 0.5)
        assert (sum(loop.contains(middle) for loop in loops) % 2 == 1) == (not occupied[row, col])
    free = np.pad(~occupied, 1)
    edges = (free[1:] != free[:-1]).sum() + (free[:, 1:] != free[:, :-1]).sum()
    assert sum(loop.length for loop in loops) == pytest.approx(edges)


def room_plan():
    occupied = np.zeros((40, 60), bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[10:20, 30:33] = True
    return occupied


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (-3.0, 1.0, 0.5)])
def test_a_plan_becomes_a_world_with_the_same_free_space(origin):
    world = world_from_grid(room_plan(), 0.1, origin=origin)
    worlds.check_world(world, footprint_radius=0.5)
    assert world.free_space().area == pytest.approx((~room_plan()).sum() * 0.01, rel=1e-4)
    inside = shapely.Point(
        origin[0] + 1.0 * np.cos(origin[2]) - 1.0 * np.sin(origin[2]),
        origin[1] + 1.0 * np.sin(origin[2]) + 1.0 * np.cos(origin[2]),
    )
    assert world.free_space().contains(inside)


def test_the_true_map_of_a_plan_is_the_plan():
    truth = worlds.true_map(world_from_grid(room_plan(), 0.1), 0.1)
    row, col = (round(-value / 0.1) for value in (truth.origin[1], truth.origin[0]))
    free = truth.free[row : row + 40, col : col + 60] | truth.occupied[row : row + 40, col : col + 60]
    # walls of a plan are surfaces without thickness, and so mark a cell on their upper or right side
    assert (free[1:-1, 1:-1] != ~room_plan()[1:-1, 1:-1]).mean() < 0.03


def picture(occupied):
    """The PGM of boolean cells, row 0 at the bottom."""
    return p5(np.where(np.flipud(occupied), 0, 254))


def test_map_server_maps_are_imported_the_right_way_up(tmp_path):
    world = import_map(write(tmp_path, picture(room_plan()), origin=[0.0, 0.0, 0.0]))
    assert world.name == "map"
    free = world.free_space()
    assert free.area == pytest.approx((~room_plan()).sum() * 0.0025)
    assert not free.contains(shapely.Point(31.5 * 0.05, 15 * 0.05))  # the pillar, in the lower half
    assert free.contains(shapely.Point(31.5 * 0.05, 25 * 0.05))


def test_a_million_cells_are_imported_in_under_five_seconds(tmp_path):
    rng = np.random.default_rng(0)
    occupied = np.kron(rng.random((100, 100)) < 0.15, np.ones((10, 10), bool))
    occupied |= rng.random(occupied.shape) < 0.002
    begin = time.process_time()
    world = import_map(write(tmp_path, picture(occupied)))
    assert time.process_time() - begin < 5.0
    assert len(world.boundary_segments()) > 5000


def test_full_and_empty_plans_are_refused():
    with pytest.raises(worlds.WorldError, match="without a free cell"):
        world_from_grid(np.ones((3, 3), bool), 0.1)
    with pytest.raises(worlds.WorldError, match="expected rows and columns"):
        world_from_grid(np.ones(3, bool), 0.1)


def test_plans_that_reach_too_far_are_refused_in_one_line():
    with pytest.raises(worlds.WorldError, match="less than or equal to 1000") as caught:
        world_from_grid(room_plan(), 50.0)
    assert "\n" not in str(caught.value)
