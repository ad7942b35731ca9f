# SPDX-License-Identifier: MIT
"""Compare a map's walls with the exact true walls, drawn on the map's own cells.

Two rasters of one wall differ by up to a cell, because their cells lie differently. Measures between them show the
rasters as well as the error: true walls drawn exactly on shifted cells have an IoU of about 0.45. Here the true
walls are drawn as lines on the cells of the map itself, so that a perfect map has no error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from eval.map.grids import lookup
from slam.occupancy import OccupancyGrid
from slam.se2 import compose, inverse, transform_points

_SPACING = 0.2
"""Distance between the points of a wall that mark cells [cells]."""


@dataclass(frozen=True)
class ExactWallError:
    """Errors of the walls of a map against exact true walls."""

    walls_within_cell_rate: float
    """Share of the map's wall cells with a true wall in the same or a neighbouring cell, 0 to 1."""
    wall_distance_subcell_m: float
    """Mean distance between walls of the map and true walls, both directions averaged [m]."""


def exact_wall_error(
    grid: OccupancyGrid,
    truth: OccupancyGrid,
    T_truth_grid: ArrayLike,
    observable: NDArray[np.bool_],
    walls: NDArray[np.float64],
) -> ExactWallError | None:
    """Compare a map, moved by `T_truth_grid` (3,), with true walls `(x0, y0, x1, y1)` [m] (n, 4) in the truth's frame.

    Only walls in occupied cells of `truth` count: a lidar can see these. Distances are measured from each wall cell of
    the map to the nearest cell with a true wall, and back from the `observable` ones (rows, cols of the truth).
    A wall that is displaced by d crosses into the next cell in a share d / cell of all positions relative to the
    raster, so the mean distance is d also where d is below a cell. Unit m, range 0 and up, below
    1 mm for a perfect map.
    Trap: noise that marks the neighbours of a wall counts with the side of a cell.
    Returns None where the map has no wall, or no true wall is observable.
    """
    points = points_on(walls, _SPACING * min(grid.resolution, truth.resolution))
    points = points[lookup(truth, points) > OccupancyGrid.OCCUPIED]
    seen = OccupancyGrid(probability=observable.astype(np.float32), resolution=truth.resolution, origin=truth.origin)
    in_view = lookup(seen, points) > 0.0
    found = np.argwhere(grid.occupied)[:, ::-1]
    if len(found) == 0 or not in_view.any():
        return None
    cells = transform_points(inverse(compose(T_truth_grid, grid.origin)), points) / grid.resolution
    every, visible = (np.unique(np.floor(part).astype(np.intp), axis=0) for part in (cells, cells[in_view]))
    tree = cKDTree(every)
    steps = tree.query(found, p=np.inf)[0]
    to_truth, from_truth = tree.query(found)[0], cKDTree(found).query(visible)[0]
    return ExactWallError(
        walls_within_cell_rate=float(np.mean(np.asarray(steps) <= 1.0)),
        wall_distance_subcell_m=0.5 * grid.resolution * float(np.mean(to_truth) + np.mean(from_truth)),
    )


def points_on(walls: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return points on segments (n, 4) [m] at most `spacing` [m] apart, ends included, (k, 2) [m]."""
    begin, step = walls[:, :2], walls[:, 2:] - walls[:, :2]
    counts = np.ceil(np.hypot(step[:, 0], step[:, 1]) / spacing).astype(np.intp) + 1
    rows = np.repeat(np.arange(len(walls)), counts)
    number = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = number / np.maximum(counts[rows] - 1, 1)
    points: NDArray[np.float64] = begin[rows] + share[:, None] * step[rows]
    return points
