# SPDX-License-Identifier: MIT
"""From poses, weights, scans and grids to the shapes that are drawn: numpy only, no viewer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose

UNKNOWN = 255
"""Value of a cell that was never observed; 0 = free ... 100 = occupied (nav_msgs/OccupancyGrid: -1)."""
ELLIPSE_SIGMAS = 2.4477
"""Half axes of the drawn ellipse in standard deviations: it holds 95 % of a plane normal distribution,
sqrt(-2 ln 0.05)."""
LIGHT, HEAVY = (120, 170, 235), (200, 20, 60)
"""Colours of a particle without weight and of the heaviest one."""


@dataclass(frozen=True)
class Extent:
    """A rectangle in the world's frame that a top view should show [m]."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the rectangle [m]."""
        return (self.x_min + self.x_max) / 2.0, (self.y_min + self.y_max) / 2.0


def extent_of(grid: OccupancyGrid, T_world_map: ArrayLike) -> Extent:
    """The rectangle about all known cells of a map; the whole grid where none is known."""
    known = grid.known if grid.known.any() else np.ones_like(grid.known)
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    corners_grid = [
        (col * grid.resolution, row * grid.resolution)
        for col in (cols[0], cols[-1] + 1)
        for row in (rows[0], rows[-1] + 1)
    ]
    corners = se2.transform_points(se2.compose(T_world_map, grid.origin), corners_grid)
    (x_min, y_min), (x_max, y_max) = corners.min(axis=0), corners.max(axis=0)
    return Extent(float(x_min), float(y_min), float(x_max), float(y_max))


def cells_from_top(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """Percent of occupation, (rows, cols), row 0 = highest y as in a picture; `UNKNOWN` where never observed."""
    values = grid.probability[::-1] * np.float32(100.0) + np.float32(0.5)
    np.fmin(values, np.float32(UNKNOWN), out=values)  # of NaN and a number fmin takes the number
    return values.astype(np.uint8)


def scan_points(scan: Scan, most: int) -> NDArray[np.float32]:
    """End points of the hits in the robot's frame [m], (n, 2); every k-th one, so that n <= most."""
    hit = np.flatnonzero(scan.hit)
    hit = hit[:: max(1, -(-len(hit) // most))]
    ranges, angles = scan.ranges[hit], scan.angles[hit]
    ends = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
    return se2.transform_points(scan.mount, ends).astype(np.float32)


def lifted(poses: ArrayLike, z: float) -> NDArray[np.float32]:
    """Positions (n, 3) at height z [m] of poses (n, 3) or points (n, 2)."""
    points = np.array(poses, dtype=np.float32)
    return np.column_stack([points[:, :2], np.full(len(points), z, np.float32)])


def headings(poses: Pose, length: float) -> NDArray[np.float32]:
    """Vectors (n, 3) of the given length [m] along the headings of poses (n, 3)."""
    theta = poses[:, 2]
    return np.column_stack([length * np.cos(theta), length * np.sin(theta), np.zeros(len(poses))]).astype(np.float32)


def quaternion(theta: float) -> tuple[float, float, float, float]:
    """Rotation about z by theta [rad] as (x, y, z, w)."""
    return 0.0, 0.0, float(np.sin(theta / 2.0)), float(np.cos(theta / 2.0))


def weight_colours(weights: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours (n, 3) of particles: from light blue, no weight, to red, the heaviest of them."""
    share = (weights / weights.max())[:, None]
    colours: NDArray[np.uint8] = np.rint((1.0 - share) * LIGHT + share * HEAVY).astype(np.uint8)
    return colours


def ellipse(covariance: NDArray[np.float64]) -> tuple[tuple[float, float], float]:
    """Half axes [m] of the ellipse that holds 95 % of the positions, and the angle of its long axis [rad].

    covariance: (3, 3) or (2, 2), of x and y first
    """
    variances, axes = np.linalg.eigh(covariance[:2, :2])
    half = ELLIPSE_SIGMAS * np.sqrt(np.maximum(variances, 0.0))
    return (float(half[1]), float(half[0])), float(np.arctan2(axes[1, 1], axes[0, 1]))


def branches(paths: Sequence[Pose]) -> list[NDArray[np.float64]]:
    """The tree that the particles' histories form, each limb drawn once: strips (n, 2) of positions.

    paths: one (length, 3) per particle, all of the same length, oldest first. Histories that were shared up to some
    scan are equal up to there, bit by bit; a later strip begins at the pose where it leaves the earlier ones.
    """
    positions = np.ascontiguousarray(np.asarray(paths)[:, :, :2])
    points = positions.view(np.complex128)[:, :, 0]  # one number a position: compared in one go
    shared = (points[:, None] == points).sum(axis=2)
    leaves_at = np.tril(shared, -1).max(axis=1)
    return [
        strip[max(first - 1, 0) :]
        for strip, first in zip(positions, leaves_at.tolist(), strict=True)
        if first < positions.shape[1]
    ]


def spread_over_weights(weights: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Numbers of `count` particles from the heaviest to the lightest, evenly by rank."""
    ranks = np.rint(np.linspace(0, len(weights) - 1, count)).astype(np.intp)
    chosen: NDArray[np.intp] = np.argsort(-weights, kind="stable")[ranks]
    return chosen
