# SPDX-License-Identifier: MIT
"""Walls against exact walls: a perfect map has no error on any cells, a displaced one its displacement."""

import numpy as np
import pytest

import worlds
from eval.files.true_walls import read_true_walls
from eval.map.error import map_error
from eval.map.exact_walls import exact_wall_error, points_on
from eval.map.grids import grid_from_true_map
from slam.occupancy import OccupancyGrid
from slam.se2 import compose, inverse, transform_points

CELL = 0.05


def of_world(name):
    """The exact true map, its grid, and the points of its walls that lie in wall cells."""
    exact = worlds.true_map(worlds.load(name), CELL)
    truth = grid_from_true_map(exact)
    points = points_on(exact.walls, 0.005)
    return exact, truth, points[truth.occupied[tuple(np.floor((points - truth.origin[:2]) / CELL).astype(int).T[::-1])]]


EXACT, TRUTH, SEEN = of_world("office")


def drawn(T_truth_grid, shift=(0.0, 0.0), seen=SEEN) -> OccupancyGrid:
    """The exact walls, moved by `shift` [m], drawn on cells that lie at `T_truth_grid`."""
    at = transform_points(inverse(T_truth_grid), seen + shift)
    cells = np.floor(at / CELL).astype(int)
    low = cells.min(axis=0)
    col, row = (cells - low).T
    probability = np.zeros((row.max() + 1, col.max() + 1), dtype=np.float32)
    probability[row, col] = 1.0
    return OccupancyGrid(probability=probability, resolution=CELL, origin=(*(low * CELL), 0.0))


def cells_at(rng):
    return np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(-np.pi, np.pi)])


@pytest.mark.parametrize("seed", range(5))
def test_a_perfect_map_has_no_error_on_any_cells(seed):
    T = cells_at(np.random.default_rng(seed))
    found = exact_wall_error(drawn(T), TRUTH, T, TRUTH.known, EXACT.walls)
    assert found.walls_within_cell_rate == 1.0
    assert found.wall_distance_subcell_m < 0.001
    # the same map shows the raster where it is compared with the cells of the true map
    assert map_error(drawn(T), TRUTH, T, TRUTH.known).occupied[0].iou < 0.6


def test_the_true_map_itself_has_no_error():
    found = exact_wall_error(TRUTH, TRUTH, np.zeros(3), TRUTH.known, EXACT.walls)
    assert found.walls_within_cell_rate == 1.0
    assert found.wall_distance_subcell_m < 0.001


@pytest.mark.parametrize("shift", [0.01, 0.02, 0.04, 0.08])
def test_a_displacement_below_a_cell_is_measured(shift):
    """A wall moves along its normal by shift times the cosine, on average over all directions by 2 / pi of it."""
    exact, truth, seen = of_world("apartment")
    rng = np.random.default_rng(3)
    means = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
        T = cells_at(rng)
        grid = drawn(T, (shift * np.cos(angle), shift * np.sin(angle)), seen)
        means.append(exact_wall_error(grid, truth, T, truth.known, exact.walls).wall_distance_subcell_m)
    assert np.mean(means) == pytest.approx(2.0 / np.pi * shift, rel=0.25)


def test_walls_two_cells_off_are_not_within_a_cell():
    grid = drawn(np.zeros(3))
    half = grid.probability.copy()
    half[:, half.shape[1] // 2 :] = 0.0
    moved = OccupancyGrid(probability=half, resolution=CELL, origin=tuple(compose((0.3, 0.2, 0.0), grid.origin)))
    found = exact_wall_error(moved, TRUTH, np.zeros(3), TRUTH.known, EXACT.walls)
    assert found.walls_within_cell_rate < 0.5


def test_without_walls_there_is_no_error():
    empty = OccupancyGrid(probability=np.zeros_like(TRUTH.probability), resolution=CELL, origin=TRUTH.origin)
    assert exact_wall_error(empty, TRUTH, np.zeros(3), TRUTH.known, EXACT.walls) is None
    assert exact_wall_error(TRUTH, TRUTH, np.zeros(3), np.zeros_like(TRUTH.known), EXACT.walls) is None


def test_the_walls_of_a_dataset_are_those_of_its_world(tmp_path):
    assert read_true_walls(tmp_path, TRUTH) is None
    (tmp_path / "config.toml").write_text('[settings]\nworld = "office"\n')
    assert len(read_true_walls(tmp_path, TRUTH)) > 100
    (tmp_path / "world.toml").write_text(worlds.dumps(worlds.load("maze")))
    assert read_true_walls(tmp_path, TRUTH) is None  # the walls of another world
