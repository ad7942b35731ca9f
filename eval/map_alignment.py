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


def best_rigid_alignment(grid: OccupancyGrid, truth: OccupancyGrid, T_truth_grid: ArrayLike) -> Pose:
    """`T_truth_grid` (3,) that fits the map's occupied cells to the truth's best, near the one given.

    Least squares on the distance field of the true walls (Fitzgibbon, "Robust registration of 2D and 3D point sets",
    BMVC 2001), soft-L1 loss, first with walls up to 1 m, then up to 0.2 m away pulling. Returns the given motion
    where either map has no occupied cell or nothing better is found. Trap: a local search, good for about 1 m and
    5 degrees; and it flatters a map, so it is reported beside the score under the trajectory's alignment.
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

    def residuals(change: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
        at = transform_points(compose(compose(start, centre), change), local)
        return np.minimum(_interpolate(field, at, frame, truth.resolution, reach), reach)

    change = np.zeros(3)
    for reach in (1.0, 0.2):
        fit = optimize.least_squares(
            residuals,
            change,
            args=(reach,),
            loss="soft_l1",
            f_scale=0.05,
            diff_step=[1e-3] * 3,
            x_scale=[0.1, 0.1, 0.01],
        )
        if np.mean(residuals(fit.x, 0.2)) < np.mean(residuals(change, 0.2)):
            change = fit.x
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
