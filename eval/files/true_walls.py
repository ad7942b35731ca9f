# SPDX-License-Identifier: MIT
"""Read the exact true walls of a dataset or a run from its world."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eval.map.exact_walls import points_on
from slam.occupancy import OccupancyGrid

MIN_DRAWN_SHARE = 0.9
"""Smallest share of occupied true cells with a wall of the world in them; below, the world is another one."""
_LIDAR_HEIGHT = 0.2
"""Height at which walls are read [m]; lidars of floor robots sit at 0.1 to 0.4 m."""


def read_true_walls(folder: Path, truth: OccupancyGrid) -> NDArray[np.float64] | None:
    """Return the walls `(x0, y0, x1, y1)` [m], (n, 4), of the world of a dataset (`world.toml`) or run (`config.toml`).

    Returns None where no world is named, it cannot be read, or its walls are not those of the true map `truth`.
    """
    from worlds import WorldError, load  # takes a geometry library along
    from worlds.raster import drawn_walls

    try:
        walls = drawn_walls(load(_world_of(folder)), _LIDAR_HEIGHT)
    except (OSError, WorldError, KeyError, TypeError, ValueError):
        return None
    drawn = np.zeros(truth.probability.shape, dtype=np.float32)
    corner = np.array(truth.origin[:2])
    cells: NDArray[np.intp] = np.floor((points_on(walls, 0.2 * truth.resolution) - corner) / truth.resolution).astype(
        np.intp
    )
    col, row = cells[:, 0], cells[:, 1]
    inside = (row >= 0) & (row < drawn.shape[0]) & (col >= 0) & (col < drawn.shape[1])
    drawn[row[inside], col[inside]] = 1.0
    occupied = truth.occupied
    return walls if occupied.any() and drawn[occupied].mean() >= MIN_DRAWN_SHARE else None


def _world_of(folder: Path) -> str:
    """Return the name or path of the world; raise KeyError where none is named."""
    if (folder / "world.toml").is_file():
        return str(folder / "world.toml")
    settings = tomllib.loads((folder / "config.toml").read_text(encoding="utf-8"))["settings"]
    return str(settings["world"])
