# SPDX-License-Identifier: MIT
"""Cells of one map read from another, whatever the frame and the resolution."""

import numpy as np

from eval.map.grids import cell_centres, grid_from_true_map, lookup
from slam.occupancy import OccupancyGrid
from worlds import TrueMap


def test_lookup_finds_each_cell_by_its_centre_in_any_frame():
    rng = np.random.default_rng(1)
    grid = OccupancyGrid(probability=rng.random((7, 9), dtype=np.float32), resolution=0.1, origin=(3.0, -2.0, 0.7))
    centres = cell_centres(grid, grid.known)
    np.testing.assert_array_equal(lookup(grid, centres), grid.probability.ravel())
    assert np.isnan(lookup(grid, centres + 100.0)).all()


def test_the_true_map_of_a_world_becomes_1_0_and_unknown():
    occupied, free = np.array([[True, False, False]]), np.array([[False, True, False]])
    grid = grid_from_true_map(TrueMap(occupied=occupied, free=free, resolution=0.1, origin=(0.0, 0.0, 0.0)))
    np.testing.assert_array_equal(grid.probability, [[1.0, 0.0, np.nan]])
