# SPDX-License-Identifier: MIT
"""The map as other programs see it: a dense grid of occupancy probabilities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class OccupancyGrid:
    """Probabilities of occupation on square cells; row 0 has the lowest y, column 0 the lowest x (ROS order)."""

    probability: NDArray[np.float32]
    """P(occupied), (rows, cols), in [0, 1]; NaN = never observed."""
    resolution: float
    """Side of a cell [m]."""
    origin: tuple[float, float, float]
    """Pose `(x, y, theta)` [m, m, rad] of the outer corner of cell (0, 0) in the map's frame."""

    OCCUPIED = 0.65
    """A cell counts as occupied above this probability (ROS map_server's `occupied_thresh`)."""
    FREE = 0.25
    """A cell counts as free below this probability (nav2's `free_thresh`)."""

    def __post_init__(self) -> None:
        if self.probability.ndim != 2:
            raise ValueError(f"probability must be (rows, cols), got shape {self.probability.shape}")
        if not self.resolution > 0:
            raise ValueError(f"resolution must be positive, got {self.resolution} m")

    @property
    def known(self) -> NDArray[np.bool_]:
        """Cells that were observed, (rows, cols)."""
        return ~np.isnan(self.probability)

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """Cells with P(occupied) > `OCCUPIED`, (rows, cols)."""
        mask: NDArray[np.bool_] = self.probability > self.OCCUPIED  # False where NaN
        return mask

    @property
    def free(self) -> NDArray[np.bool_]:
        """Cells with P(occupied) < `FREE`, (rows, cols)."""
        mask: NDArray[np.bool_] = self.probability < self.FREE
        return mask
