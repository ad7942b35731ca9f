# SPDX-License-Identifier: MIT
"""Area of a world that an estimated map shows correctly, by the true map: the reward of `testbed/Explore-v0`."""

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
"""Walls count as correct up to this far from a true wall [cells of the true map]."""


_EVEN = 0.5
"""Cells with a lower P(occupied) count as mapped free."""


class Mapped(NamedTuple):
    """Correctly mapped area."""

    floor: float
    """Area of the cells that are mapped free and truly are floor [m²]."""
    walls: float
    """Area of the cells that are mapped occupied within `_TOLERANCE` of a true wall [m²]."""
    coverage: float
    """`floor` as a share of all true floor."""


class MapScore:
    """Compares maps of one world with the true one."""

    def __init__(self, truth: TrueMap) -> None:
        self._truth = truth
        side = 2 * _TOLERANCE + 1
        self._near_walls = ndimage.binary_dilation(truth.occupied, np.ones((side, side), dtype=np.bool_))
        self._floor_area = float(truth.free.sum()) * truth.resolution**2

    def mapped(self, grid: OccupancyGrid, T_world_map: Pose) -> Mapped:
        """Return the correctly mapped area; `T_world_map` (3,) is the true pose of the grid's frame."""
        cell = grid.resolution**2
        floor = self._count(grid, grid.probability < _EVEN, self._truth.free, T_world_map) * cell
        walls = self._count(grid, grid.occupied, self._near_walls, T_world_map) * cell
        return Mapped(floor, walls, min(floor / self._floor_area, 1.0))

    def _count(self, grid: OccupancyGrid, shown: NDArray[np.bool_], true: NDArray[np.bool_], T_world_map: Pose) -> int:
        """Return the number of map cells in `shown` (map cells) that are in `true` (cells of the true map)."""
        resolution = self._truth.resolution
        corner = compose(inverse(self._truth.origin), compose(T_world_map, grid.origin))
        corner[:2] /= resolution
        return int(count_agreeing(shown, true, corner, grid.resolution / resolution))
