# SPDX-License-Identifier: MIT
"""The rigid motion that puts a map's walls best onto the true ones: tells a misplaced map from a bent one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, optimize

from eval.grids import cell_centres
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, compose, transform_points

MAX_POINTS = 3000
_SCALE = np.array([0.1, 0.1, 0.01])
"""Steps of the search that matter alike [m, m, rad]."""


def best_rigid_alignment(grid: OccupancyGrid, truth: OccupancyGrid, T_truth_grid: ArrayLike) -> Pose:
    """`T_truth_grid` (3,) that fits the map's occupied cells to the truth's best, near the one given.

    Minimises the mean distance to the nearest true wall, read from a distance field, by the simplex method (Nelder
    and Mead, 1965): first with walls counting as at most 1 m away, then 0.2 m, so that walls that are wrong do not
    pull. Returns the given motion where either map has no occupied cell or nothing better is found. Trap: a local
    search, good for about 1 m and 5 degrees; and it flatters a map, so it is reported beside the score under the
    trajectory's alignment.
    """
    start = np.asarray(T_truth_grid, dtype=np.float64)
    points = cell_centres(grid, grid.occupied)
    if len(points) == 0 or not truth.occupied.any():
        return start
    points = points[:: -(-len(points) // MAX_POINTS)]
    centre = np.array([*points.mean(axis=0), 0.0])
    local = points - centre[:2]
    field = truth.resolution * ndimage.distance_transform_edt(~truth.occupied)
    frame = np.asarray(truth.origin)

    def cost(scaled: NDArray[np.float64], reach: float) -> float:
        at = transform_points(compose(compose(start, centre), scaled * _SCALE), local)
        return float(np.mean(np.minimum(_interpolate(field, at, frame, truth.resolution, reach), reach)))

    change = np.zeros(3)
    for reach, size in ((1.0, 5.0), (0.2, 0.5)):
        simplex = change + size * np.concatenate([np.zeros((1, 3)), np.eye(3)])
        fit = optimize.minimize(
            cost, change, (reach,), method="Nelder-Mead", options={"initial_simplex": simplex, "xatol": 1e-3}
        )
        if cost(fit.x, 0.2) < cost(change, 0.2):
            change = fit.x
    change = change * _SCALE
    return compose(compose(compose(start, centre), change), -centre)


def _interpolate(
    field: NDArray[np.float64], points: NDArray[np.float64], origin: Pose, resolution: float, outside: float
) -> NDArray[np.float64]:
    """Bilinear values of a field given at cell centres, at points (n, 2) [m]; `outside` off the map."""
    cos, sin = np.cos(origin[2]), np.sin(origin[2])
    dx, dy = points[:, 0] - origin[0], points[:, 1] - origin[1]
    col, row = (cos * dx + sin * dy) / resolution - 0.5, (-sin * dx + cos * dy) / resolution - 0.5
    values: NDArray[np.float64] = ndimage.map_coordinates(field, [row, col], order=1, cval=outside)
    return values
