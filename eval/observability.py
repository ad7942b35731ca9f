# SPDX-License-Identifier: MIT
"""Which cells of the true map a perfect lidar would have seen from the true path: only these can be asked of a map."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.occupancy import OccupancyGrid
from slam.se2 import inverse, transform_points

RAYS = 720
"""Rays from each viewpoint, half a degree apart."""


def observable_cells(
    truth: OccupancyGrid, positions: ArrayLike, *, range_max: float = np.inf, spacing: float = 0.25
) -> NDArray[np.bool_]:
    """Cells seen from the positions (n, 2) [m, map frame], (rows, cols): free ones on the rays, walls at their ends.

    The lidar stands at the positions and looks all around up to `range_max` [m]. Positions are thinned out to one
    per square of `spacing` [m]. Rays are followed cell by cell (Amanatides and Woo, Eurographics 1987) and end in the
    first cell that is not free. Traps: a lidar of a narrow field of view sees less; cells further away than the
    spacing of the rays allows (11 m at 0.1 m cells) are seen only thanks to the other positions.
    """
    at = np.asarray(positions, dtype=np.float64).reshape(-1, 2)
    _, first = np.unique(np.floor(at / spacing).astype(np.int64), axis=0, return_index=True)
    cells = transform_points(inverse(truth.origin), at[np.sort(first)]) / truth.resolution
    rows, cols = truth.probability.shape
    cells = cells[(cells >= 0.0).all(axis=1) & (cells < [cols, rows]).all(axis=1)]
    cells = cells[truth.free[cells[:, 1].astype(np.intp), cells[:, 0].astype(np.intp)]]

    angles = np.arange(RAYS) * (2.0 * np.pi / RAYS) + 1e-4  # off the axes: no ray runs along a line of the grid
    start = np.repeat(cells, RAYS, axis=0)
    way = np.tile(np.column_stack([np.cos(angles), np.sin(angles)]), (len(cells), 1))
    return _cells_on_rays(truth, start, way, range_max / truth.resolution)


def _cells_on_rays(
    truth: OccupancyGrid, start: NDArray[np.float64], way: NDArray[np.float64], reach: float
) -> NDArray[np.bool_]:
    """Cells that rays pass through up to the first that is not free; start (n, 2), way (n, 2), reach in cells."""
    rows, cols = truth.probability.shape
    free, seen = truth.free.ravel(), np.zeros(rows * cols, dtype=np.bool_)
    cell = np.floor(start).astype(np.int64)
    sign = np.where(way > 0.0, 1, -1)
    per_cell = np.abs(1.0 / way)  # length of ray per cell crossed, in x and in y
    next_line = (cell + (sign > 0) - start) / way  # length of ray up to the next line between cells
    while len(cell):
        flat = cell[:, 1] * cols + cell[:, 0]
        seen[flat] = True
        axis = (next_line[:, 1] < next_line[:, 0]).astype(np.intp)
        ray = np.arange(len(cell))
        length = next_line[ray, axis]
        cell[ray, axis] += sign[ray, axis]
        next_line[ray, axis] += per_cell[ray, axis]
        inside = (cell[:, 0] >= 0) & (cell[:, 0] < cols) & (cell[:, 1] >= 0) & (cell[:, 1] < rows)
        on = free[flat] & inside & (length <= reach)
        cell, sign, per_cell, next_line = cell[on], sign[on], per_cell[on], next_line[on]
    return (seen & truth.known.ravel()).reshape(rows, cols)
