# SPDX-License-Identifier: MIT
"""What is asked of the free cells of a map without a list of them is what the list says."""

import numpy as np
import pytest

from slam.localization.fixed_map import checked_start, free_lattice, free_space_moments
from slam.occupancy import OccupancyGrid
from tests.slam.localization.free_cells import free_cells


def rooms(seed: int) -> OccupancyGrid:
    """A map of 30 x 47 cells of which a third is free."""
    probability = np.random.default_rng(seed).choice([0.0, 1.0, np.nan], size=(30, 47)).astype(np.float32)
    return OccupancyGrid(probability=probability, resolution=0.05, origin=(3.0, -2.0, 0.7))


@pytest.mark.parametrize("seed", range(3))
def test_moments_are_those_of_the_cells(seed):
    free = free_cells(rooms(seed))
    mean, covariance = free_space_moments(rooms(seed))
    np.testing.assert_allclose(mean, free.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(covariance, np.cov(free.T, ddof=0), rtol=1e-9)


@pytest.mark.parametrize("spacing", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_random_cell_of_each_square(seed, spacing):
    free = free_cells(rooms(seed))
    mixed = free[np.random.default_rng(9).permutation(len(free))]
    _, first = np.unique(np.floor(mixed / spacing).astype(int), axis=0, return_index=True)
    np.testing.assert_array_equal(free_lattice(rooms(seed), spacing, np.random.default_rng(9)), mixed[first])


def test_a_start_is_measured_to_the_nearest_free_cell():
    """The map is turned: distances are the same."""
    grid = rooms(0)
    x, y, theta = grid.origin
    for point in ((-1.0, 0.4), (3.0, 1.0), (1.1, 5.0)):
        start = (
            x + np.cos(theta) * point[0] - np.sin(theta) * point[1],
            y + np.sin(theta) * point[0] + np.cos(theta) * point[1],
            0.0,
        )
        away = np.hypot(*(free_cells(grid) - point).T).min()
        assert checked_start(start, grid, away + 1e-9) == pytest.approx(start)
        with pytest.raises(ValueError, match=f"lies {away:.2f} m outside"):
            checked_start(start, grid, away - 1e-9)
