# SPDX-License-Identifier: MIT
"""The map of one particle without a copy, and the grey levels in which maps are drawn."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.grid.particle_maps import ParticleMaps, probability_of_counts
from slam.occupancy import LOG_ODDS_LIMITS

UNKNOWN = 205
"""Grey level of a cell that was never observed (as in the images of ROS map_server)."""
FREE_FROM = 225
"""Grey levels from here up are cells that are rather free; 255 is certainly free."""
OCCUPIED_TO = 160
"""Grey levels up to here are cells that are rather occupied; 0 is certainly occupied."""


class MapCells(NamedTuple):
    """The map of one particle as the filter stores it; valid until the filter takes in the next scan."""

    table: NDArray[np.int32]
    """Number of the tile at each place, (rows, columns), row 0 at the lowest y; 0 = the empty tile."""
    tiles: NDArray[np.uint16]
    """Counts words of the tiles, (tiles, side * side), row by row from the lowest y."""
    corner: tuple[int, int]
    """Number of the column and of the row of cells at the table's corner, counted from the map's origin."""
    cell: float
    """Side of a cell [m]."""
    touched: NDArray[np.int64]
    """Number of the last scan that has changed the tile at each place, (rows, columns)."""
    scans: int
    """Number of the last scan."""
    grey: NDArray[np.uint8]
    """Grey level of each counts word, (65536,)."""
    tables: NDArray[np.int32]
    """The tables of all particles, (particles, rows, columns)."""
    walls: NDArray[np.uint16]
    """Which cells are walls: bit x of word y of a tile, (tiles, side)."""


def map_cells(maps: ParticleMaps, particle: int) -> MapCells:
    """The map of a particle, without a copy."""
    grids = maps.grids
    corner = int(grids.corner[0]), int(grids.corner[1])
    return MapCells(
        table=grids.table[particle],
        tiles=grids.counts,
        corner=corner,
        cell=grids.cell,
        touched=maps.touched,
        scans=maps.scans,
        grey=_grey_of_words(maps.config.occupied_share),
        tables=grids.table,
        walls=grids.walls,
    )


@cache
def _grey_of_words(occupied_share: float) -> NDArray[np.uint8]:
    words = np.arange(1 << 16, dtype=np.uint16)
    return grey_levels(probability_of_counts(words, occupied_share))


def grey_levels(probability: ArrayLike) -> NDArray[np.uint8]:
    """Grey levels of P(occupied), of any shape: white is free, black is occupied, `UNKNOWN` is NaN.

    The scale is linear in the log-odds on both sides of 0.5, with a gap in the middle, so that one look at a cell
    tells free from occupied from unknown.
    """
    p = np.asarray(probability)
    grey = np.full(p.shape, UNKNOWN, np.uint8)
    known = ~np.isnan(p)  # most cells of a map's rectangle are not
    seen = p[known].astype(np.float64)
    lowest, highest = LOG_ODDS_LIMITS
    with np.errstate(divide="ignore"):
        log_odds = np.clip(np.log(seen) - np.log1p(-seen), lowest, highest)
    free = FREE_FROM + (255 - FREE_FROM) * log_odds / lowest
    occupied = OCCUPIED_TO * (1.0 - log_odds / highest)
    grey[known] = np.rint(np.where(log_odds < 0.0, free, occupied))
    return grey


def probability_of_greys(grey: NDArray[np.uint8]) -> NDArray[np.float32]:
    """P(occupied) of grey levels, of any shape, but for their rounding; NaN = never observed."""
    level = grey.astype(np.float64)
    lowest, highest = LOG_ODDS_LIMITS
    free = lowest * (level - FREE_FROM) / (255 - FREE_FROM)
    occupied = highest * (1.0 - level / OCCUPIED_TO)
    p = 1.0 / (1.0 + np.exp(-np.where(level >= FREE_FROM, free, occupied)))
    return np.where(grey == UNKNOWN, np.nan, p).astype(np.float32)
