# SPDX-License-Identifier: MIT
"""The best rigid motion is found from anywhere, keeps to the given one where it can, and mends no bent map."""

import numpy as np
import pytest

from eval.map.alignment import best_rigid_alignment
from eval.map.grids import grid_from_true_map
from eval.map.walls import wall_distances
from slam.occupancy import OccupancyGrid
from slam.se2 import compose, wrap_angle
from tests.eval.helpers import moved, room, with_wall
from worlds import load, true_map

IDENTITY = np.zeros(3)
DIVIDED = with_wall(room(), slice(20, 60), 70)


def of_world(name: str) -> OccupancyGrid:
    return grid_from_true_map(true_map(load(name), 0.05))


def as_mapped(truth: OccupancyGrid, T, seed: int = 0) -> OccupancyGrid:
    """The truth moved by T, with three in ten wall cells unseen and a fifth as many again invented on the floor."""
    rng = np.random.default_rng(seed)
    probability = truth.probability.copy()
    walls, floor = np.argwhere(truth.occupied), np.argwhere(truth.free)
    unseen, invented = walls[rng.random(len(walls)) < 0.3], floor[rng.choice(len(floor), len(walls) // 5)]
    probability[tuple(unseen.T)] = np.nan
    probability[tuple(invented.T)] = 1.0
    return moved(OccupancyGrid(probability=probability, resolution=truth.resolution, origin=truth.origin), T)


def miss(found, T) -> tuple[float, float]:
    """What is left of T after the alignment that was found: distance [m] and angle [deg]."""
    left = compose(found, T)
    return float(np.hypot(left[0], left[1])), float(np.degrees(abs(wrap_angle(left[2]))))


@pytest.mark.parametrize("T", [(0.3, -0.2, 0.03), (-0.6, 0.1, -0.05), (0.0, 0.0, 0.02), (0.0, 0.0, 0.0)])
def test_a_small_motion_is_undone(T):
    metres, degrees = miss(best_rigid_alignment(moved(DIVIDED, T), DIVIDED, IDENTITY), T)
    assert metres < 0.01
    assert degrees < 0.2


@pytest.mark.parametrize(
    "T", [(0.0, 0.0, np.pi), (3.0, 0.0, 0.0), (0.0, -3.0, np.pi / 2), (-8.0, 5.0, -2.2), (0.4, 0.1, 0.5)]
)
@pytest.mark.parametrize("world", ["office", "courtyard"])
def test_any_turn_and_shift_is_undone_on_a_map_with_faults(world, T):
    truth = of_world(world)
    metres, degrees = miss(best_rigid_alignment(as_mapped(truth, T), truth, IDENTITY), T)
    assert metres < 0.02
    assert degrees < 0.1


def test_a_part_of_the_map_finds_its_place_at_the_far_end():
    truth = of_world("courtyard")
    part = as_mapped(truth, (3.0, 0.0, 1.0))
    probability = part.probability.copy()
    probability[:, :600] = np.nan
    corner = OccupancyGrid(probability=probability, resolution=part.resolution, origin=part.origin)
    assert miss(best_rigid_alignment(corner, truth, IDENTITY), (3.0, 0.0, 1.0))[0] < 0.05


@pytest.mark.parametrize("world", ["symmetric", "long_corridor"])
@pytest.mark.parametrize("T", [(0.3, -0.1, 0.02), (2.0, 0.5, 0.3)])
def test_a_symmetric_world_does_not_turn_the_map_round(world, T):
    truth = of_world(world)
    metres, degrees = miss(best_rigid_alignment(as_mapped(truth, T), truth, IDENTITY), T)
    assert metres < 0.02
    assert degrees < 0.1


def test_a_map_without_a_wall_stays_where_it_is():
    empty = OccupancyGrid(probability=np.zeros((9, 9), np.float32), resolution=0.05, origin=(0.0, 0.0, 0.0))
    start = np.array([1.0, 2.0, 0.3])
    np.testing.assert_array_equal(best_rigid_alignment(empty, DIVIDED, start), start)
    np.testing.assert_array_equal(best_rigid_alignment(DIVIDED, empty, start), start)


def test_a_bent_map_is_not_mended():
    truth = with_wall(room(), slice(20, 100), 80)
    bent = with_wall(with_wall(room(), slice(20, 100), 80, 0.0), slice(20, 100), 90)
    best = best_rigid_alignment(bent, truth, IDENTITY)
    there, _ = wall_distances(bent, truth, best, truth.known)
    assert there.mean > 0.05
