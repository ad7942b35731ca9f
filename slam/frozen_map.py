# SPDX-License-Identifier: MIT
"""A finished map as the matcher reads it: walls at the centres of cells, with lines through them and a field about."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slam._ray_kernels import Rays
from slam.config import MapConfig
from slam.occupancy import OccupancyGrid
from slam.parallel import Threads
from slam.particle_maps import ParticleMaps

TABLES = 64
"""Particles that are matched at a time: each reads the one map through a table of its own."""


class FrozenMap:
    """One map that nobody changes, shared by all particles.

    Inside, poses are seen from the outer corner of the map's cell (0, 0), so that any origin will do, a turned one
    included: `T_map_grid` leads back to the map's frame.
    """

    def __init__(self, grid: OccupancyGrid, config: MapConfig, threads: Threads) -> None:
        """Read the walls of `grid`; `config.cell` does not count, the grid's resolution does.

        Raises:
            ValueError: the map has no walls or no free space, or the field's radius does not suit its resolution.
        """
        if not grid.occupied.any():
            raise ValueError(f"the map has no walls: no cell is occupied with more than {OccupancyGrid.OCCUPIED}")
        if not grid.free.any():
            raise ValueError(f"the map has no free space: no cell is occupied with less than {OccupancyGrid.FREE}")
        self.grid = grid
        self.T_map_grid = np.array(grid.origin, dtype=np.float64)
        self.maps = maps_of_walls(wall_faces(grid), replace(config, cell=grid.resolution), threads)
        self.maps.descend(np.zeros(TABLES, dtype=np.int64))

    def distance_to_free(self, point: NDArray[np.float64]) -> float:
        """Distance [m] from a point (2,), seen from the grid's corner, to the centre of the nearest free cell."""
        return float(np.hypot(*(free_cells(self.grid) - point).T).min())


def free_cells(grid: OccupancyGrid) -> NDArray[np.float64]:
    """Centres of the free cells, (n, 2) [m], seen from the grid's corner."""
    return _centres(grid.free, grid.resolution)


def wall_faces(grid: OccupancyGrid) -> NDArray[np.float64]:
    """Centres (n, 2) [m] of the occupied cells beside free ones, seen from the grid's corner.

    Beams end at faces of walls. What lies behind them would, in maps with solid walls, hide where the face is.
    """
    free = np.pad(grid.free, 1)
    rows, columns = grid.free.shape
    beside = np.zeros_like(grid.free)
    for below in range(3):
        for left in range(3):
            beside |= free[below : below + rows, left : left + columns]
    faces = grid.occupied & beside
    return _centres(faces if faces.any() else grid.occupied, grid.resolution)


def maps_of_walls(points: NDArray[np.float64], config: MapConfig, threads: Threads) -> ParticleMaps:
    """Maps of one particle in which a beam has ended once at each of the points (n, 2) [m] and none has passed."""
    centre = np.append(0.5 * (points.min(axis=0) + points.max(axis=0)), 0.0)
    ends = points - centre[:2]
    maps = ParticleMaps(1, config, threads)
    maps.register(centre[None], Rays(origins=ends, ends=ends, hit=np.ones(len(ends), np.bool_)))
    return maps


def _centres(mask: NDArray[np.bool_], resolution: float) -> NDArray[np.float64]:
    """Centres of the cells of a mask (rows, columns), (n, 2) [m]."""
    rows, columns = np.nonzero(mask)
    return np.column_stack([(columns + 0.5) * resolution, (rows + 0.5) * resolution])
