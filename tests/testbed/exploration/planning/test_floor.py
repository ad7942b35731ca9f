# SPDX-License-Identifier: MIT
"""Planning on maps drawn by hand: where the robot fits, paths, frontiers, what a goal promises."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.exploration.planning._grid_kernels import shortest_paths, visible_sum
from testbed.exploration.planning.floor import Floor
from testbed.exploration.planning.frontiers import Frontier, find_frontiers
from testbed.exploration.planning.goals import information_gain, most_information, nearest
from tests.testbed.exploration.hand_drawn_maps import grid_of

RADIUS = 0.17

ROOMS = """
####################
#........#.........#
#........#.........#
#..................#
#........#.........#
#........#.........?
#........#.........?
#........#.........?
####################
"""  # a character is 0.2 m: two rooms with a door of 0.2 m, and an opening of 0.6 m on the right


def wide_door():
    return grid_of(
        ROOMS.replace("#........#.........#\n#..................#", "#..................#\n#..................#"), 8
    )


def test_open_cells_are_farther_from_walls_than_the_radius():
    floor = Floor(grid_of(ROOMS), RADIUS)
    rows, cols = np.nonzero(floor.open)
    walls = floor.centres(np.argwhere(floor.occupied))
    for point in floor.centres(np.column_stack([rows, cols]))[::7]:
        assert np.hypot(*(walls - point).T).min() > RADIUS
    assert not floor.open[floor.cell_of(1.9, 1.0)]
    assert floor.open[floor.cell_of(0.9, 0.9)]


@pytest.mark.parametrize("point", [(0.31, 0.52), (3.07, 1.41)])
def test_cells_and_points_belong_together(point):
    floor = Floor(grid_of(ROOMS), RADIUS)
    centre = floor.centre(floor.cell_of(*point))
    assert np.abs(centre - point).max() <= 0.5 * floor.cell + 1e-9
    assert floor.cell_of(*centre) == floor.cell_of(*point)


def test_paths_lead_through_wide_doors_only():
    narrow, wide = Floor(grid_of(ROOMS), RADIUS), Floor(wide_door(), RADIUS)
    start = narrow.nearest_open(0.9, 0.9)
    assert np.isinf(narrow.shortest_paths_from(start).costs[narrow.nearest_open(3.0, 0.9)])
    start, goal = wide.nearest_open(1.0, 1.0), wide.nearest_open(6.4, 1.0)
    paths = wide.shortest_paths_from(start)
    path = paths.path(goal)
    np.testing.assert_allclose(path[[0, -1]], [wide.centre(start), wide.centre(goal)])
    length = np.hypot(*np.diff(path, axis=0).T).sum()
    assert np.hypot(*(path[-1] - path[0])) < length <= paths.costs[goal] + 1e-9
    walls = wide.centres(np.argwhere(wide.occupied))
    fine = np.concatenate([np.linspace(a, b, 30) for a, b in pairwise(path)])
    assert min(np.hypot(*(walls - point).T).min() for point in fine) > RADIUS


def test_a_robot_near_a_wall_plans_from_the_nearest_open_cell():
    floor = Floor(grid_of(ROOMS), RADIUS)
    near = floor.centre(floor.nearest_open(0.22, 0.9))
    assert 0.1 < np.hypot(*(near - [0.22, 0.9])) < 0.5
    assert floor.nearest_open(-40.0, 0.9) is None
    assert Floor(grid_of("####\n####"), RADIUS).nearest_open(0.3, 0.3) is None


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_costs_are_those_of_a_search_that_tries_every_edge(seed):
    """Bellman-Ford until nothing changes."""
    rng = np.random.default_rng(seed)
    step_cost = np.where(rng.random((7, 9)) < 0.3, np.inf, rng.uniform(1.0, 4.0, (7, 9)))
    step_cost[3, 4] = 1.0
    costs, before = shortest_paths(step_cost, 3, 4)
    expected = np.full((7, 9), np.inf)
    expected[3, 4] = 0.0
    for _ in range(63):
        for r, c in np.argwhere(np.isfinite(step_cost)):
            for dr, dc in [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)]:
                r2, c2 = r + dr, c + dc
                if not (0 <= r2 < 7 and 0 <= c2 < 9) or np.isinf(step_cost[r2, c2]):
                    continue
                if dr and dc and np.isinf(step_cost[r, c2]) and np.isinf(step_cost[r2, c]):
                    continue
                step = np.hypot(dr, dc) * 0.5 * (min(step_cost[r, c], step_cost[r2, c2]) + step_cost[r2, c2])
                expected[r2, c2] = min(expected[r2, c2], expected[r, c] + step)
    np.testing.assert_allclose(costs, expected, rtol=1e-12)
    assert np.array_equal(before >= 0, np.isfinite(expected) & (expected > 0))


def test_frontiers_are_reachable_borders_of_the_known_floor():
    floor = Floor(wide_door(), RADIUS)
    found = find_frontiers(floor, floor.shortest_paths_from(floor.nearest_open(1.0, 1.0)))
    assert len(found) == 1
    x, y = floor.centre(found[0].goal)
    assert 7.0 < x < 7.7  # the opening lies at x = 7.6, y = 0.4 to 1.6
    assert 0.4 < y < 1.6
    assert found[0].length == pytest.approx(1.2, abs=0.2)
    closed = Floor(grid_of(ROOMS), RADIUS)
    assert find_frontiers(closed, closed.shortest_paths_from(closed.nearest_open(0.9, 0.9))) == []


def test_cells_that_one_beam_has_passed_are_floor():
    """Such a cell is neither free nor unknown to ROS; a ring of them must not hide the frontier behind it."""
    grid = wide_door()
    grid.probability[:, 150:152][grid.probability[:, 150:152] < 0.2] = 0.4
    floor = Floor(grid, RADIUS)
    assert len(find_frontiers(floor, floor.shortest_paths_from(floor.nearest_open(1.0, 1.0)))) == 1


def test_the_nearest_frontier_is_the_one_with_the_cheapest_way():
    frontiers = [Frontier((0, 0), 3.0, 9.0), Frontier((1, 0), 2.0, 0.5), Frontier((2, 0), 4.0, 1.0)]
    assert nearest(None, frontiers) is frontiers[1]


def test_information_prefers_a_near_room_to_a_niche():
    picture = """
    #######################
    #......................
    #......................
    #..#...................
    #..####################
    #..#???????????????????
    #??#???????????????????
    #######################
    """  # a niche below on the left, an open side on the right
    floor = Floor(grid_of(picture.replace("\n    ", "\n"), 8), RADIUS)
    paths = floor.shortest_paths_from(floor.nearest_open(5.0, 2.5))
    frontiers = find_frontiers(floor, paths)
    choose = most_information(12.0)
    assert len(frontiers) == 2
    assert floor.centre(choose(floor, frontiers).goal)[0] > 8.0
    far = [frontier._replace(cost=100.0) if frontier.goal[1] > 80 else frontier for frontier in frontiers]
    assert floor.centre(choose(floor, far).goal)[0] < 2.0


def test_information_gain_is_largest_for_unknown_cells():
    gain = information_gain(np.array([0.5, 0.4, 0.6, 0.119, 0.97], dtype=np.float32))
    assert gain[0] == gain.max()
    assert gain[1] == pytest.approx(gain[2])
    assert np.all(gain[3:] < 0.01)


def test_what_is_in_sight_is_counted_once_and_walls_end_the_view():
    values, opaque = np.ones((21, 21)), np.zeros((21, 21), bool)
    disc = np.hypot(*(np.indices((21, 21)) - 10.0)) <= 5.5  # from the middle of a cell to that of another
    assert visible_sum(values, opaque, 10, 10, 5.0, 360) == pytest.approx(disc.sum(), rel=0.1)
    opaque[:, 12] = True
    half = visible_sum(values, opaque, 10, 10, 50.0, 720)
    assert half == pytest.approx(21 * 13, rel=0.02)
    assert visible_sum(values, ~opaque, 10, 10, 50.0, 90) == 1.0
