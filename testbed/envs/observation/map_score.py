# SPDX-License-Identifier: MIT
"""How much of a world an estimated map shows correctly: what `testbed/Explore-v0` rewards. It knows the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, compose, inverse
from testbed.envs.observation._grid_kernels import count_agreeing
from worlds import TrueMap

_TOLERANCE = 1
"""Walls may be off by so many cells of the true map."""


_EVEN = 0.5
"""P(occupied) of a cell of which the map says nothing."""


class Mapped(NamedTuple):
    """What a map shows correctly."""

    floor: float
    """Cells that are rather free than not, and are floor [m²]."""
    walls: float
    """Occupied cells beside or on a wall [m²]."""
    coverage: float
    """Floor shown as a share of all floor."""


class MapScore:
    """Compares maps of one world with the true one."""

    def __init__(self, truth: TrueMap) -> None:
        self._truth = truth
        side = 2 * _TOLERANCE + 1
        self._near_walls = ndimage.binary_dilation(truth.occupied, np.ones((side, side), dtype=np.bool_))
        self._floor_area = float(truth.free.sum()) * truth.resolution**2

    def mapped(self, grid: OccupancyGrid, T_world_map: Pose) -> Mapped:
        """What `grid` shows correctly when its frame stands at `T_world_map` (3,), where the robot truly began."""
        cell = grid.resolution**2
        floor = self._count(grid, grid.probability < _EVEN, self._truth.free, T_world_map) * cell
        walls = self._count(grid, grid.occupied, self._near_walls, T_world_map) * cell
        return Mapped(floor, walls, min(floor / self._floor_area, 1.0))

    def _count(self, grid: OccupancyGrid, shown: NDArray[np.bool_], true: NDArray[np.bool_], T_world_map: Pose) -> int:
        """Cells of the map that are shown so, and truly are."""
        resolution = self._truth.resolution
        corner = compose(inverse(self._truth.origin), compose(T_world_map, grid.origin))
        corner[:2] /= resolution
        return int(count_agreeing(shown, true, corner, grid.resolution / resolution))
