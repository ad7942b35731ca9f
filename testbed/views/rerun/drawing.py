# SPDX-License-Identifier: MIT
"""Poses, weights, scans and grids as the shapes that are drawn: numpy only, no viewer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose

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


def thinned_hits(scan: Scan, most: int) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Ranges (n,) [m], angles (n,) [rad] and mount (3,) of the hits; every k-th one, so that n <= most."""
    (hit,) = scan.hit.nonzero()
    hit = hit[:: max(1, -(-len(hit) // most))]
    return scan.ranges[hit], scan.angles[hit], np.asarray(scan.mount)


def scan_points(scan: Scan, most: int) -> NDArray[np.float64]:
    """End points of these hits in the robot's frame [m], (n, 2)."""
    ranges, angles, mount = thinned_hits(scan, most)
    return se2.transform_points(mount, np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)]))


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


def weight_colours(shares: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Colours (n, 3) of particles by their share of the largest weight: from light blue, 0, to red, 1."""
    share = shares[:, None]
    colours: NDArray[np.uint8] = np.rint((1.0 - share) * LIGHT + share * HEAVY).astype(np.uint8)
    return colours


def ellipses(covariances: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Half axes (n, 2) [m], the long one first, of the ellipses that hold 95 % of the positions, and the angles (n,) of
    their long axes [rad].

    covariances: (n, 3, 3) or (n, 2, 2), of x and y first
    """
    variances, axes = np.linalg.eigh(covariances[:, :2, :2])
    half = ELLIPSE_SIGMAS * np.sqrt(np.maximum(variances[:, ::-1], 0.0))
    return half, np.arctan2(axes[:, 1, 1], axes[:, 0, 1])


def spreads(rows: Sequence[tuple[Pose, NDArray[np.float64]]]) -> NDArray[np.float64]:
    """Standard deviations (rows,) of the position over the particles [m]; rows (poses (n, 3), weights (n,), whose sum
    is 1)."""
    positions, weights = np.concatenate([row[0][:, :2] for row in rows]), np.concatenate([row[1] for row in rows])
    lengths = [len(row[1]) for row in rows]
    starts = np.cumsum([0, *lengths[:-1]])
    means = np.add.reduceat(weights[:, None] * positions, starts)
    off = positions - np.repeat(means, lengths, axis=0)
    deviations: NDArray[np.float64] = np.sqrt(np.add.reduceat(weights * (off * off).sum(axis=1), starts))
    return deviations


def wall_lines(grid: OccupancyGrid) -> list[NDArray[np.float64]]:
    """Rows and columns of occupied cells of a map as lines (2, 2) in the map's frame [m]."""
    lines = []
    for across in (False, True):
        cells = grid.occupied.T if across else grid.occupied
        step = np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        (row, first), (_, last) = np.nonzero(step == 1), np.nonzero(step == -1)
        long = last - first > 1
        ends = [np.column_stack([at[long] + half, row[long] + 0.5]) for at, half in ((first, 0.0), (last, 0.0))]
        lines.append(np.stack([end[:, ::-1] if across else end for end in ends], axis=1))
    points = np.concatenate(lines).reshape(-1, 2) * grid.resolution
    return list(se2.transform_points(grid.origin, points).reshape(-1, 2, 2))
