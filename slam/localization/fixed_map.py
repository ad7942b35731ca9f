# SPDX-License-Identifier: MIT
"""A finished map as the matcher reads it: walls at the centres of cells, lines through them, a field of distances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam._threads import Threads
from slam.config import MapConfig
from slam.grid.wall_maps import maps_of_walls
from slam.occupancy import OccupancyGrid

TABLES = 64
"""Particles that are matched at a time: each reads the one map through a tile table of its own."""


class FixedMap:
    """One map that never changes, shared by all particles.

    Inside, poses are seen from the outer corner of the map's cell (0, 0), so that the origin may be anywhere, turned
    too: `T_map_grid` leads back to the map's frame.
    """

    def __init__(self, grid: OccupancyGrid, config: MapConfig, threads: Threads) -> None:
        """Read the walls of `grid`; `config.cell` does not count, the grid's resolution does.

        Raises:
            ValueError: the map has no walls or no free space, or the field's radius does not suit its resolution.
        """
        check_map(grid)
        self.grid = grid
        self.T_map_grid = np.array(grid.origin, dtype=np.float64)
        self.maps = maps_of_walls(wall_faces(grid), replace(config, cell=grid.resolution), threads)
        self.maps.inherit(np.zeros(TABLES, dtype=np.int64))


def check_map(grid: OccupancyGrid) -> None:
    """Raise ValueError where a map has no walls or no free space: a robot cannot be found in it."""
    if not grid.occupied.any():
        raise ValueError(f"the map has no walls: expected cells occupied with more than {OccupancyGrid.OCCUPIED}")
    if not grid.free.any():
        raise ValueError(f"the map has no free space: expected cells occupied with less than {OccupancyGrid.FREE}")


def checked_start(start: ArrayLike, grid: OccupancyGrid, max_distance: float) -> se2.Pose:
    """A start pose (3,) in the map's frame as an array.

    Raises:
        ValueError: it is not three finite numbers, or lies more than `max_distance` [m] away from all free cells.
    """
    pose = np.asarray(start, dtype=np.float64)
    if pose.shape != (3,) or not np.all(np.isfinite(pose)):
        raise ValueError(f"start must be three finite numbers (x, y, theta), got {pose.tolist()}")
    away = _distance_to_free(grid, se2.between(grid.origin, pose)[:2])
    if away > max_distance:
        raise ValueError(
            f"start ({pose[0]:g}, {pose[1]:g}) m lies {away:.2f} m outside of the map's free space, "
            f"expected at most {max_distance:g} m"
        )
    return pose


def free_space_moments(grid: OccupancyGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean (2,) [m] and covariance (2, 2) [m^2] of the centres of the free cells, seen from the grid's corner.

    By sums over rows and columns: the centres of a map of 4000 x 4000 cells would take a quarter of a gigabyte.
    """
    free = grid.free
    x, y = _axes(grid)
    in_columns, in_rows = free.sum(axis=0), free.sum(axis=1)
    count = in_rows.sum()
    mean: NDArray[np.float64] = np.array([in_columns @ x, in_rows @ y]) / count
    dx, dy = x - mean[0], y - mean[1]
    xy = float(dy @ np.array([dx[row].sum() for row in free]))
    covariance: NDArray[np.float64] = np.array([[in_columns @ dx**2, xy], [xy, in_rows @ dy**2]]) / count
    return mean, covariance


def free_lattice(grid: OccupancyGrid, spacing: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """A random free cell in each square of a lattice that has one: centres, (n, 2) [m], seen from the grid's corner.

    spacing: side of a square [m]
    """
    x, y = _axes(grid)
    cells = np.flatnonzero(grid.free)
    cells = cells[rng.permutation(len(cells))]
    rows = np.floor(y / spacing).astype(np.int32)
    columns = np.floor(x / spacing).astype(np.int32) * (rows.max() + 1)  # squares in the order of x, then y
    squares = columns[cells % len(x)] + rows[cells // len(x)]
    chosen = cells[np.unique(squares, return_index=True)[1]]
    return np.column_stack([x[chosen % len(x)], y[chosen // len(x)]])


def _distance_to_free(grid: OccupancyGrid, point: NDArray[np.float64]) -> float:
    """Distance of a point (2,) [m], seen from the grid's corner, to the centre of the nearest free cell [m]."""
    x, y = _axes(grid)
    away = np.hypot(y - point[1], [np.abs(x[row] - point[0]).min(initial=np.inf) for row in grid.free])
    return float(away.min())


def _axes(grid: OccupancyGrid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x of the columns and y of the rows [m], at the centres of cells, seen from the grid's corner."""
    rows, columns = grid.free.shape
    x: NDArray[np.float64] = (np.arange(columns, dtype=np.float64) + 0.5) * grid.resolution
    y: NDArray[np.float64] = (np.arange(rows, dtype=np.float64) + 0.5) * grid.resolution
    return x, y


def wall_faces(grid: OccupancyGrid) -> NDArray[np.float64]:
    """Centres (n, 2) [m] of the occupied cells next to free ones, seen from the grid's corner.

    Beams end at faces of walls. In maps with solid walls the cells behind them would hide where the face is.
    """
    free = np.pad(grid.free, 1)
    rows, columns = grid.free.shape
    near_free = np.zeros_like(grid.free)
    for below in range(3):
        for left in range(3):
            near_free |= free[below : below + rows, left : left + columns]
    faces = grid.occupied & near_free
    return _centres(faces if faces.any() else grid.occupied, grid.resolution)


def _centres(mask: NDArray[np.bool_], resolution: float) -> NDArray[np.float64]:
    """Centres of the cells of a mask (rows, columns), (n, 2) [m]."""
    rows, columns = np.nonzero(mask)
    return np.column_stack([(columns + 0.5) * resolution, (rows + 0.5) * resolution])
