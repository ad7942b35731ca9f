# SPDX-License-Identifier: MIT
"""Draw the true map from the same surfaces that the lidar sees."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from worlds.errors import WorldError
from worlds.world import World, segments_of, surface_of

MAX_CELLS = 100_000_000
"""Largest number of cells of a map."""
_NUDGE = 1e-6
"""Solids are shrunk by this much [m], so that a face between two cells marks the cell inside of the solid."""


@dataclass(frozen=True, kw_only=True)
class TrueMap:
    """The map of an ideal mapper. Row 0 has the lowest y, column 0 the lowest x."""

    occupied: NDArray[np.bool_]
    """Cells that a surface of a wall or block runs through, (rows, cols), as far as they touch free cells by a side or
    corner: the inside of solids and the outside of the building, which no lidar can see, are neither occupied nor
    free."""
    free: NDArray[np.bool_]
    """Cells without a surface that are connected with the start by their sides, (rows, cols)."""
    resolution: float
    """Side of a cell [m]."""
    origin: tuple[float, float, float]
    """Pose `(x, y, theta)` [m, m, rad] of the outer corner of cell (0, 0) in the world's frame."""
    walls: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    """The drawn surfaces, as segments `(x0, y0, x1, y1)` [m], (n, 4); faces between two cells are moved into
    the one inside of the solid."""


def true_map(world: World, resolution: float = 0.05, *, height: float = 0.0, margin: float = 0.5) -> TrueMap:
    """Draw `world` as an ideal lidar at `height` [m] would see it, glass included.

    resolution: side of a cell [m]; cells lie on whole multiples of it. margin: empty border [m].
    Raises `WorldError` if the map had more than `MAX_CELLS` cells, `ValueError` if the resolution is not positive.
    """
    if not resolution > 0:
        raise ValueError(f"resolution must be positive, got {resolution} m")
    solid = world.cross_section(height)
    x_low, y_low, x_high, y_high = solid.bounds if not solid.is_empty else (world.start.x, world.start.y) * 2
    first_col, first_row = (int(np.floor((low - margin) / resolution)) for low in (x_low, y_low))
    cols = int(np.ceil((x_high + margin) / resolution)) - first_col
    rows = int(np.ceil((y_high + margin) / resolution)) - first_row
    if rows * cols > MAX_CELLS:
        raise WorldError(
            f"world {world.name!r}: a map of {rows} x {cols} cells at {resolution:g} m is above the limit of "
            f"{MAX_CELLS} cells, expected a smaller world or larger cells"
        )
    surface = np.zeros((rows, cols), dtype=np.bool_)
    walls = segments_of(surface_of(_shrunk(solid)))
    in_cells = walls / resolution - np.array([first_col, first_row] * 2)
    surface[cells_crossed(in_cells)] = True
    start = (
        int(np.floor(world.start.y / resolution)) - first_row,
        int(np.floor(world.start.x / resolution)) - first_col,
    )
    free = _connected(~surface, start)
    return TrueMap(
        occupied=surface & _dilated(free),
        free=free,
        resolution=resolution,
        origin=(first_col * resolution, first_row * resolution, 0.0),
        walls=walls,
    )


def drawn_walls(world: World, height: float) -> NDArray[np.float64]:
    """Return the surfaces that `true_map` draws at `height` [m], as segments `(x0, y0, x1, y1)` [m], (n, 4)."""
    return segments_of(surface_of(_shrunk(world.cross_section(height))))


def _shrunk(solid: BaseGeometry) -> BaseGeometry:
    parts = shapely.get_parts(solid)
    areas = shapely.get_dimensions(parts) == 2
    return shapely.union_all([*shapely.buffer(parts[areas], -_NUDGE, join_style="mitre"), *parts[~areas]])


def cells_crossed(segments: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of the unit cells that share more than a point with segments `(x0, y0, x1, y1)`, (n, 4).

    The result is exact: segments are cut at every grid line, and each piece lies in the cell of its midpoint.
    """
    begin, step = segments[:, :2], segments[:, 2:] - segments[:, :2]
    every = np.arange(len(segments))
    cuts = [(every, np.zeros(len(segments))), (every, np.ones(len(segments)))]
    for axis in range(2):
        low, high = np.sort(segments[:, [axis, axis + 2]], axis=1).T
        first = np.ceil(low)
        count = np.where(step[:, axis] != 0.0, np.maximum(np.floor(high) + 1.0 - first, 0.0), 0.0).astype(np.int64)
        which = np.repeat(every, count)
        line = first[which] + np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
        cuts.append((which, np.clip((line - begin[which, axis]) / step[which, axis], 0.0, 1.0)))
    which, at = (np.concatenate(parts) for parts in zip(*cuts, strict=True))
    order = np.lexsort((at, which))
    which, at = which[order], at[order]
    piece = (which[1:] == which[:-1]) & (at[1:] > at[:-1])
    middle, which = 0.5 * (at[:-1] + at[1:])[piece], which[:-1][piece]
    cells = np.floor(begin[which] + middle[:, None] * step[which]).astype(np.intp)
    return cells[:, 1], cells[:, 0]


def _dilated(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells with their eight neighbours, (rows, cols)."""
    padded = np.pad(cells, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]


def _connected(open_cells: NDArray[np.bool_], start: tuple[int, int]) -> NDArray[np.bool_]:
    """Return the open cells that are connected with cell `start` (row, col) by their sides, (rows, cols).

    Runs of open cells along the rows are joined with the runs that they touch in the next row. This does not need
    scipy.ndimage, whose import takes longer than most maps.
    """
    rows, cols = open_cells.shape
    if not (0 <= start[0] < rows and 0 <= start[1] < cols) or not open_cells[start]:
        return np.zeros_like(open_cells)
    edges = np.diff(np.pad(open_cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, begin = np.nonzero(edges == 1)
    end = np.nonzero(edges == -1)[1]
    width = cols + 1
    begins, ends = row * width + begin, row * width + end
    first = np.searchsorted(ends, begins + width, side="right")
    touching = np.searchsorted(begins, ends + width) - first
    upper = np.repeat(np.arange(len(row)), touching)
    lower = np.arange(len(upper)) + np.repeat(first - np.cumsum(touching) + touching, touching)
    group = _groups(len(row), upper, lower)
    chosen = group == group[np.searchsorted(begins, start[0] * width + start[1], side="right") - 1]
    steps = np.zeros((rows, width), dtype=np.int8)
    steps[row[chosen], begin[chosen]] = 1
    steps[row[chosen], end[chosen]] = -1
    reached: NDArray[np.bool_] = np.cumsum(steps, axis=1, dtype=np.int8)[:, :-1] > 0
    return reached


def _groups(count: int, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return for each of `count` nodes the smallest number of a node that the edges between a and b connect it with."""
    group = np.arange(count)
    while (group[a] != group[b]).any():
        low = np.minimum(group[a], group[b])
        np.minimum.at(group, group[a], low)
        np.minimum.at(group, group[b], low)
        while (group[group] != group).any():
            group = group[group]
    return group
