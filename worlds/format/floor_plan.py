# SPDX-License-Identifier: MIT
"""Worlds from floor plans: the edges of the floor of an occupancy raster, or of a ROS map, become walls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy import ndimage
from shapely.geometry import Polygon

from worlds.elements import MAX_COORDINATE, Position, Wall
from worlds.errors import WorldError
from worlds.file_names import to_name
from worlds.format.known_floor import find_floor
from worlds.format.map_file import read_map_file
from worlds.raster import MAX_CELLS
from worlds.world import Start, World

Pose = tuple[float, float, float]
"""`(x, y, theta)` [m, m, rad]."""


def import_map(path: str | Path, *, start: Pose | None = None) -> World:
    """Return the world of a ROS map as `import_map_with_notes` does, without the notes."""
    return import_map_with_notes(path, start=start)[0]


def import_map_with_notes(path: str | Path, *, start: Pose | None = None) -> tuple[World, tuple[str, ...]]:
    """Make a world of a ROS map (`worlds.format.map_file`); also returns notes on what a reader must know.

    Free cells are the floor, everything else is solid (`worlds.format.known_floor`). Map coordinates beyond the limit
    of a world, such as UTM, are moved to the origin; `World.offset` keeps the difference. start: pose of the robot in
    the map's frame, by default the place farthest from all walls in the largest connected part of the floor.
    Raises WorldError, naming the file, as `read_map_file` and `world_from_grid` do.
    """
    path = Path(path)
    file = read_map_file(path)
    notes = list(file.notes)
    offset = _offset(file.origin, max(file.probability.shape) * file.resolution)
    if offset != (0.0, 0.0):
        notes.append(f"{path}: origin: ({offset[0]:.2f}, {offset[1]:.2f}) m is kept as offset, the world starts at 0")
    x, y, yaw = file.origin
    try:
        floor = find_floor(file.probability < 0.5, np.isnan(file.probability), file.resolution)
        world = world_from_grid(
            ~floor.free,
            file.resolution,
            origin=(x - offset[0], y - offset[1], yaw),
            start=None if start is None else (start[0] - offset[0], start[1] - offset[1], start[2]),
            start_cell=floor.start,
            name=to_name(path.stem),
        )
    except WorldError as error:
        raise WorldError(f"{path}: {error}") from None
    notes += [f"{path}: {note}" for note in floor.notes]
    return world.model_copy(update={"offset": offset}), tuple(notes)


def _offset(origin: Pose, extent: float) -> tuple[float, float]:
    """Return the part of a map's origin that a world cannot hold [m]; 0 where it fits."""
    fits = max(abs(origin[0]), abs(origin[1])) + 1.5 * extent <= MAX_COORDINATE
    return (0.0, 0.0) if fits else (origin[0], origin[1])


def world_from_grid(
    occupied: NDArray[np.bool_],
    resolution: float,
    *,
    origin: Pose = (0.0, 0.0, 0.0),
    start: Pose | None = None,
    start_cell: tuple[int, int] | None = None,
    name: str = "floor plan",
) -> World:
    """Make a world whose walls are the edges of occupied cells (rows, cols); row 0 has the lowest y.

    resolution: side of a cell [m]; origin: pose of the outer corner of cell (0, 0) [m, m, rad]; start: pose of the
    robot in the world, by default the centre of `start_cell` (row, col), or else the place farthest from all walls. A
    wall of one cell is put around the plan, so that its outline is closed. The world has no tour.
    Raises `WorldError` if the plan is too large or has no free cell.
    """
    if occupied.ndim != 2 or occupied.size == 0:
        raise WorldError(f"floor plan of shape {occupied.shape}, expected rows and columns")
    if occupied.size > MAX_CELLS:
        raise WorldError(f"floor plan of {occupied.size} cells, expected at most {MAX_CELLS}")
    if occupied.all():
        raise WorldError("floor plan without a free cell, expected free space")
    framed, first = _framed(occupied)
    if start is None:
        cell = start_cell or _roomiest_cell(framed, first)
        (position,) = _placed(np.array([[cell[1] + 0.5, cell[0] + 0.5]]), resolution, origin)
        start = (*position, 0.0)
    try:
        return World(
            name=name,
            description=f"Imported floor plan of {occupied.shape[0]} x {occupied.shape[1]} cells at {resolution:g} m",
            start=Start(x=start[0], y=start[1], theta=start[2]),
            walls=[
                Wall(name=f"edge {k + 1}", points=_placed(loop + first, resolution, origin), closed=True)
                for k, loop in enumerate(edge_loops(framed))
            ],
        )
    except ValidationError as error:  # too many edges, or too far from the origin
        raise WorldError(f"floor plan {name!r}: {error.errors(include_url=False)[0]['msg']}") from None


def _framed(occupied: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return the part of a plan with free cells and one cell of frame, and the (x, y) of its corner in cells."""
    rows, cols = (np.flatnonzero((~occupied).any(axis=axis)) for axis in (1, 0))
    part = occupied[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    return np.pad(part, 1, constant_values=True), np.array([cols[0] - 1.0, rows[0] - 1.0])


def edge_loops(occupied: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """Return the closed lines between occupied and free cells: corners (n, 2) `(x, y)` in cells, straight runs joined.

    Cells beyond the border count as occupied.
    """
    padded = np.pad(~occupied, 1)
    across = padded[:, 1:] != padded[:, :-1]  # vertical edges, between columns
    up = padded[1:] != padded[:-1]  # horizontal edges, between rows
    runs = [*_runs(across.T, vertical=True), *_runs(up, vertical=False)]
    if not runs:
        return []
    polygons = shapely.get_parts(shapely.polygonize([shapely.node(shapely.multilinestrings(runs))]))
    free = [part for part in polygons if _is_free(part, ~padded[1:-1, 1:-1])]
    rings = [ring for part in free for ring in (part.exterior, *part.interiors)]
    return [shapely.get_coordinates(ring)[:-1] for ring in shapely.simplify(rings, 0.0)]


def _runs(edges: NDArray[np.bool_], *, vertical: bool) -> list[list[Position]]:
    """Return the straight runs of cell edges as lines, in cells; each row of `edges` is one grid line."""
    ends = np.diff(np.pad(edges.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    lines, begin = np.nonzero(ends == 1)
    end = np.nonzero(ends == -1)[1]
    low, high, at = begin - 1.0, end - 1.0, lines * 1.0  # the padding shifts all by one cell
    if vertical:
        return [[(x, y0), (x, y1)] for x, y0, y1 in zip(at, low, high, strict=True)]
    return [[(x0, y), (x1, y)] for y, x0, x1 in zip(at, low, high, strict=True)]


def _is_free(part: Polygon, occupied: NDArray[np.bool_]) -> bool:
    """Return whether a polygon, whose edges all lie between free and occupied cells, consists of free cells."""
    (x0, y0), (x1, y1) = shapely.get_coordinates(part.exterior)[:2]
    normal = np.array([y0 - y1, x1 - x0]) / np.hypot(x1 - x0, y1 - y0)
    inward = 0.5 if part.exterior.is_ccw else -0.5
    step = np.array([x1 - x0, y1 - y0]) / np.hypot(x1 - x0, y1 - y0)
    col, row = np.floor(np.array([x0, y0]) + 0.5 * step + inward * normal).astype(int)
    return not occupied[row, col]


def _placed(corners: NDArray[np.float64], resolution: float, origin: tuple[float, float, float]) -> list[Position]:
    """Convert corners (n, 2) in cells to points of the world [m]."""
    cos, sin = np.cos(origin[2]), np.sin(origin[2])
    x, y = resolution * corners.T
    placed = np.stack([origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y], axis=-1).round(6)
    return [(float(px), float(py)) for px, py in placed]


def _roomiest_cell(framed: NDArray[np.bool_], first: NDArray[np.float64]) -> tuple[int, int]:
    """Return the free cell (row, col) of the whole plan that is farthest from all occupied ones."""
    distance = ndimage.distance_transform_edt(~framed)
    row, col = np.unravel_index(int(np.argmax(distance)), framed.shape)
    return int(row + first[1]), int(col + first[0])
