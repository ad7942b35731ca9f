# SPDX-License-Identifier: MIT
"""The square of the estimated map around the robot, with the robot's heading to the right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, compose, inverse
from testbed.envs.observation._grid_kernels import cut_square

_PER_SIDE = 2
"""A cell of the crop takes the highest of this many times this many map points, so that thin walls are not missed."""


@dataclass(frozen=True, kw_only=True)
class Crop:
    """Size of the square."""

    cells: int = 64
    """Cells along each side."""
    cell: float = 0.1
    """Side of a cell [m]."""

    def __post_init__(self) -> None:
        if not 1 <= self.cells <= 1024:
            raise ValueError(f"cells must be 1 to 1024, got {self.cells}")
        if not self.cell > 0.0:
            raise ValueError(f"cell must be positive, got {self.cell} m")

    @property
    def space(self) -> spaces.Box:
        """Space of the arrays that `cut` returns."""
        return spaces.Box(0.0, 1.0, (2, self.cells, self.cells), np.float32)

    def cut(self, grid: OccupancyGrid, pose: Pose) -> NDArray[np.float32]:
        """Return P(occupied), 0.5 where unknown, and whether known (0 or 1), (2, cells, cells).

        The robot at `T_map_robot` (3,) is in the centre; columns go ahead, rows to the left.
        """
        robot = compose(inverse(grid.origin), pose)
        robot[:2] /= grid.resolution
        square: NDArray[np.float32] = cut_square(
            grid.probability, robot, self.cells, self.cell / grid.resolution, _PER_SIDE
        )
        return square
