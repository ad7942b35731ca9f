# SPDX-License-Identifier: MIT
"""The world of a map: the floor on it, as far as it is connected with the robot's path, between straight walls."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry import LineString

from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from worlds import Start, Tour, Wall, World, WorldError, world_from_grid
from worlds.format.known_floor import find_floor

Floats = NDArray[np.float64]

CLEARED = 0.22
"""Floor within this distance of the path is free, because the robot passed there [m]."""
STRAIGHTENING = 0.7
"""Steps of walls up to this part of a cell are straightened."""
SINKING = 0.3
"""Walls are moved away from the floor by this part of a cell: they lie in the occupied cells, not at their edge."""
PATH_TOLERANCE = 0.02
"""The tour leaves out corners of the path that are off a straight line by less than this [m]."""


def world_of(grid: OccupancyGrid, path: Pose, name: str) -> tuple[World, tuple[str, ...]]:
    """Make a world of a map and a path `T_map_robot` (n, 3), which becomes its start and tour; also returns notes.

    Unknown cells are solid. Raises WorldError where the map has no floor.
    """
    cell, origin = grid.resolution, grid.origin
    corners = LineString(path[:, :2]).simplify(PATH_TOLERANCE) if len(path) > 1 else LineString()
    points = shapely.get_coordinates(corners)
    passed, start = _passed(grid, points, path[0])
    unknown = np.isnan(grid.probability) & ~passed
    floor = find_floor((grid.probability < 0.5) | passed, unknown, cell)
    labels, _ = ndimage.label(floor.free | passed)
    world = world_from_grid(
        _with_corners_filled(labels != labels[start]),
        cell,
        origin=origin,
        start=(float(path[0, 0]), float(path[0, 1]), float(path[0, 2])),
        start_cell=start,
        name=name,
    )
    polygon = world.free_space()
    if polygon is None:
        raise WorldError(f"{name}: the floor around the start of the path is not enclosed")
    shape = polygon.buffer(SINKING * cell, join_style="mitre").simplify(STRAIGHTENING * cell, preserve_topology=True)
    rings = [ring for part in shapely.get_parts(shape) for ring in (part.exterior, *part.interiors)]
    walls = [
        Wall(name=f"wall {k + 1}", points=[(x, y) for x, y in shapely.get_coordinates(ring)[:-1].round(4)], closed=True)
        for k, ring in enumerate(rings)
    ]
    x, y, theta = path[0].round(6).tolist()
    tour = [(px, py) for px, py in points[1:].round(4).tolist()]
    made = World(
        name=name,
        description=f"Twin of the recording {name}",
        start=Start(x=x, y=y, theta=theta),
        tour=Tour(points=tour) if tour else None,
        walls=walls,
    )
    return made, floor.notes


def _passed(
    grid: OccupancyGrid, corners: NDArray[np.float64], start: Pose
) -> tuple[NDArray[np.bool_], tuple[int, int]]:
    """Return the cells that the robot passed, (rows, cols), and the cell (row, col) of its start."""
    cell = grid.resolution
    line = shapely.segmentize(LineString(corners), 0.5 * cell)
    rows, cols = _cells(grid, shapely.get_coordinates(line))
    away = np.ones(grid.probability.shape, dtype=np.bool_)
    away[rows, cols] = False
    (row,), (col,) = _cells(grid, start[None, :2])
    return ndimage.distance_transform_edt(away) * cell <= CLEARED, (int(row), int(col))


def _cells(grid: OccupancyGrid, points: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the cells that hold points (n, 2) [m]; those beyond the map are moved to its edge."""
    x, y, theta = grid.origin
    dx, dy = points[:, 0] - x, points[:, 1] - y
    along = np.cos(theta) * dx + np.sin(theta) * dy
    across = np.cos(theta) * dy - np.sin(theta) * dx
    rows, cols = (np.floor(values / grid.resolution).astype(np.int64) for values in (across, along))
    return np.clip(rows, 0, grid.probability.shape[0] - 1), np.clip(cols, 0, grid.probability.shape[1] - 1)


def _with_corners_filled(solid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Fill a cell wherever two solid cells touch by a corner only, so that no gap opens there, (rows, cols)."""
    filled = solid.copy()
    a, b, c, d = solid[:-1, :-1], solid[:-1, 1:], solid[1:, :-1], solid[1:, 1:]
    filled[:-1, 1:] |= a & d & ~b & ~c
    filled[:-1, :-1] |= b & c & ~a & ~d
    return filled
