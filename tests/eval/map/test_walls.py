# SPDX-License-Identifier: MIT
"""Walls in metres: distance, thickness, doubles and missing ones have their known values."""

import numpy as np
import pytest

from eval.map.grids import cell_centres, resample
from eval.map.walls import wall_distances, wall_profile
from slam.occupancy import OccupancyGrid
from slam.se2 import compose, inverse
from tests.eval.helpers import moved, room, with_wall
from tests.eval.map.truth import EVERYWHERE, IDENTITY, TRUTH, like_truth


def test_the_distance_shows_shifts_below_a_cell():
    truth = with_wall(like_truth(np.zeros((60, 60))), 30, slice(None))
    there, back = wall_distances(moved(truth, (0.0, 0.013, 0.0)), truth, IDENTITY, truth.known)
    assert there.mean == pytest.approx(0.013)
    assert back.mean == pytest.approx(0.013)


@pytest.mark.parametrize("offset", [2, 4, 8])
def test_a_repeated_wall_is_double_and_an_adjacent_one_is_thick(offset):
    # The west wall is column 19; a copy inside the room along its whole length.
    doubled = with_wall(TRUTH, slice(20, 100), 19 + offset)
    west = np.zeros_like(EVERYWHERE)
    west[30:90, 19] = True
    profile = wall_profile(doubled, TRUTH, IDENTITY, west)
    assert profile.double_wall_rate == 1.0
    assert profile.wall_thickness_m == pytest.approx(0.05)
    thick = wall_profile(with_wall(TRUTH, slice(20, 100), 20), TRUTH, IDENTITY, west)
    assert thick.double_wall_rate == 0.0
    assert thick.wall_thickness_m == pytest.approx(0.10)


def test_specks_and_holes_are_not_a_second_wall():
    rng = np.random.default_rng(3)
    specked = TRUTH.probability.copy()
    behind = specked[:, 9:19]
    behind[rng.random(behind.shape) < 0.3] = 1.0  # in ground that was never seen
    specked[20:100:3, 18], specked[20:100, 17] = np.nan, 1.0  # a thick wall with holes
    west = np.zeros_like(EVERYWHERE)
    west[30:90, 19] = True
    assert wall_profile(like_truth(specked), TRUTH, IDENTITY, west).double_wall_rate == 0.0


def test_a_quarter_of_the_walls_doubled_is_a_rate_of_their_share():
    doubled = with_wall(TRUTH, slice(20, 100), 24)
    profile = wall_profile(doubled, TRUTH, IDENTITY, EVERYWHERE)
    assert profile.double_wall_rate == pytest.approx(80.0 / 400.0, abs=0.05)


def test_a_true_wall_of_two_faces_is_not_double():
    truth = with_wall(room(), slice(20, 100), slice(70, 74), np.nan)
    truth = with_wall(with_wall(truth, slice(20, 100), 69), slice(20, 100), 74)
    assert wall_profile(truth, truth, IDENTITY, truth.known).double_wall_rate == 0.0
    ghost = with_wall(truth, slice(20, 100), 64)
    faces = np.zeros_like(truth.known)
    faces[30:90, [69, 74]] = True
    # From the far face the ghost is 0.5 m away: on the edge of the cut.
    assert wall_profile(ghost, truth, IDENTITY, faces).double_wall_rate == pytest.approx(1.0)


@pytest.mark.parametrize("degrees", [2.0, -5.0])
def test_a_wall_turned_about_its_centre_has_the_mean_distance(degrees):
    truth = with_wall(like_truth(np.zeros((80, 80))), 40, slice(10, 70))  # 3 m long
    x, y = cell_centres(truth, truth.occupied).mean(axis=0)
    T = compose(compose([x, y, np.radians(degrees)], [0.0, 0.0, 0.0]), [-x, -y, 0.0])
    turned = moved(truth, tuple(T))
    expected = 0.25 * 3.0 * np.sin(np.radians(abs(degrees)))
    there, back = wall_distances(turned, truth, IDENTITY, truth.known)
    # To the nearest of cell centres 5 cm apart, not to a line: up to half a cell to the side.
    assert there.mean == pytest.approx(expected, rel=0.12)
    assert back.mean == pytest.approx(expected, rel=0.12)
    assert there.p95 == pytest.approx(0.95 * 1.5 * np.sin(np.radians(abs(degrees))), rel=0.1)
    whole, _ = wall_distances(turned, truth, inverse(T), truth.known)
    assert whole.mean < 1e-9


def on_turned_cells(grid: OccupancyGrid, turn: float) -> OccupancyGrid:
    """The same place, drawn on cells that are turned about its middle; no wall is lost between the cells."""
    canvas = OccupancyGrid(
        probability=np.zeros((240, 240), np.float32),
        resolution=grid.resolution,
        origin=tuple(compose([3.0, 2.0, turn], [-6.0, -6.0, 0.0]).tolist()),
    )
    return resample(grid, canvas, IDENTITY)


@pytest.mark.parametrize("turn", [0.3, 0.785, 1.2])
def test_profiles_do_not_depend_on_how_either_map_is_turned(turn):
    doubled = with_wall(TRUTH, slice(20, 100), 24)
    straight = wall_profile(doubled, TRUTH, IDENTITY, EVERYWHERE)
    # Both turned alike: the same cuts. Only the map's cells turned: the same walls on other cells.
    T = (1.0, -2.0, turn)
    alike = wall_profile(moved(doubled, T), moved(TRUTH, T), IDENTITY, EVERYWHERE)
    assert alike.double_wall_rate == pytest.approx(straight.double_wall_rate, abs=1e-3)
    assert alike.wall_thickness_m == pytest.approx(straight.wall_thickness_m, abs=1e-3)
    perfect = wall_profile(on_turned_cells(TRUTH, turn), TRUTH, IDENTITY, EVERYWHERE)
    assert perfect.double_wall_rate < 0.01
    assert perfect.wall_thickness_m == pytest.approx(0.05, abs=0.015)
