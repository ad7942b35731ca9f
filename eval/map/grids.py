# SPDX-License-Identifier: MIT
"""Read cells of one grid map from another; maps may differ in resolution, origin and rotation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.occupancy import OccupancyGrid
from slam.se2 import compose, inverse, transform_points

if TYPE_CHECKING:  # loading worlds takes a geometry library along
    from worlds import TrueMap


def grid_from_true_map(truth: TrueMap) -> OccupancyGrid:
    """Convert the true map to an occupancy grid: occupied 1, free 0, NaN what no lidar can see."""
    probability = np.full(truth.occupied.shape, np.nan, dtype=np.float32)
    probability[truth.free] = 0.0
    probability[truth.occupied] = 1.0
    return OccupancyGrid(probability=probability, resolution=truth.resolution, origin=truth.origin)


def cell_centres(grid: OccupancyGrid, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the centres of the cells of `mask` (rows, cols) in the map's frame [m], (k, 2), in row-major order."""
    rows, cols = np.nonzero(mask)
    return transform_points(np.asarray(grid.origin), (np.column_stack([cols, rows]) + 0.5) * grid.resolution)


def lookup(grid: OccupancyGrid, points: ArrayLike) -> NDArray[np.float32]:
    """Return P(occupied) at points (..., 2) [m, map frame]; NaN outside of the map and in unknown cells."""
    at = np.asarray(points, dtype=np.float64)
    flat = transform_points(inverse(grid.origin), at.reshape(-1, 2)) / grid.resolution
    rows, cols = grid.probability.shape
    inside = (flat[:, 0] >= 0.0) & (flat[:, 0] < cols) & (flat[:, 1] >= 0.0) & (flat[:, 1] < rows)
    found = np.full(len(flat), np.nan, dtype=np.float32)
    index = flat[inside].astype(np.intp)
    found[inside] = grid.probability[index[:, 1], index[:, 0]]
    return found.reshape(at.shape[:-1])


def resample(grid: OccupancyGrid, like: OccupancyGrid, T_like_grid: ArrayLike) -> OccupancyGrid:
    """Draw `grid` on the cells of `like`; `T_like_grid` (3,) is the frame of `grid` seen from that of `like`.

    A cell takes the probability at its centre. Where the cells of `grid` are finer, it takes the highest of k x k
    points, k = ratio rounded up, so that no thin wall falls between the points. Walls grow by up to one fine cell.
    """
    per_side = max(1, int(np.ceil(like.resolution / grid.resolution - 1e-9)))
    rows, cols = like.probability.shape
    T_grid_cells = compose(inverse(T_like_grid), like.origin)
    found = np.full((rows, cols), np.nan, dtype=np.float32)
    offsets = (np.arange(per_side) + 0.5) / per_side
    for dy in offsets:
        for dx in offsets:
            x, y = (np.arange(cols) + dx) * like.resolution, (np.arange(rows) + dy) * like.resolution
            points = transform_points(T_grid_cells, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
            found = np.fmax(found, lookup(grid, points).reshape(rows, cols))  # fmax: NaN only where all are
    return OccupancyGrid(probability=found, resolution=like.resolution, origin=like.origin)
