# SPDX-License-Identifier: MIT
"""The map as other programs see it: a dense grid of occupancy probabilities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HIT_LOG_ODDS = 1.2
"""What one hit adds to a cell's log-odds; at the default share of 0.25 a pass takes away 0.4 (OctoMap: 0.85, 0.4)."""
LOG_ODDS_LIMITS = (-2.0, 3.5)
"""Limits of a cell's log-odds, probabilities 0.12 and 0.97 as in OctoMap."""


@dataclass(frozen=True, kw_only=True, repr=False)
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

    def __repr__(self) -> str:
        """One line, for notebooks."""
        rows, cols = self.probability.shape
        x, y, theta = self.origin
        size = f"{cols} x {rows} cells of {self.resolution:g} m"
        return f"<OccupancyGrid: {size}, {self.known.mean():.0%} known, origin ({x:.2f}, {y:.2f}, {theta:.3f})>"

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


def occupancy_probability(
    hits: NDArray[np.integer], visits: NDArray[np.integer], occupied_share: float
) -> NDArray[np.float32]:
    """P(occupied) of cells from how many beams reached them and how many of these ended in them, any shape; NaN = none.

    A log-odds grid (Thrun, Burgard, Fox 2005, section 9.2) in which a hit adds `HIT_LOG_ODDS` and a pass subtracts as
    much as makes a cell even at `occupied_share` of hits, clamped as in OctoMap (Hornung et al. 2013).
    """
    hit, visit = hits.astype(np.float32), visits.astype(np.float32)
    log_odds = HIT_LOG_ODDS * (hit - (visit - hit) * occupied_share / (1.0 - occupied_share))
    probability = 1.0 / (1.0 + np.exp(-np.clip(log_odds, *LOG_ODDS_LIMITS)))
    probability[visit == 0] = np.nan
    return probability.astype(np.float32)
