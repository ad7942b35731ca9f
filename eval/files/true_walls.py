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
    rows, cols = truth.probability.shape
    drawn = np.zeros((rows, cols))
    points = points_on(walls, 0.2 * truth.resolution)
    col, row = (np.floor((points[:, k] - truth.origin[k]) / truth.resolution).astype(np.intp) for k in (0, 1))
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    drawn[row[inside], col[inside]] = 1.0
    occupied = truth.occupied
    return walls if occupied.any() and drawn[occupied].mean() >= MIN_DRAWN_SHARE else None


def _world_of(folder: Path) -> str:
    """Return the name or path of the world; raise KeyError where none is named."""
    if (folder / "world.toml").is_file():
        return str(folder / "world.toml")
    settings = tomllib.loads((folder / "config.toml").read_text(encoding="utf-8"))["settings"]
    return str(settings["world"])
