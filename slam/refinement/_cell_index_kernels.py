# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled index of the cells in which end points lie: cells are numbered as they are met.

Tiles of cells give the number of the cell at any column and row.
"""

from __future__ import annotations

import numpy as np

from slam._jit import inlined, kernel
from slam.grid._tile_kernels import MASK, SHIFT, SIDE


@kernel
def mark_tiles(points, corner, side, tiles):
    """Number the tiles in which points (n, 2) lie, in their order; tiles (rows, columns) out. Returns how many."""
    tiles[:] = -1
    count = 0
    for i in range(points.shape[0]):
        cx, cy = int((points[i, 0] - corner[0]) / side), int((points[i, 1] - corner[1]) / side)
        if tiles[cy >> SHIFT, cx >> SHIFT] < 0:
            tiles[cy >> SHIFT, cx >> SHIFT] = count
            count += 1
    return count


@kernel
def mark_cells(points, corner, side, tiles, indices, cell_of):
    """Number the cells in which points (n, 2) lie, in their order; indices (tiles, SIDE * SIDE) and the cell of each
    point cell_of (n,) out. Returns how many."""
    indices[:] = -1
    count = 0
    for i in range(points.shape[0]):
        cx, cy = int((points[i, 0] - corner[0]) / side), int((points[i, 1] - corner[1]) / side)
        tile, k = tiles[cy >> SHIFT, cx >> SHIFT], ((cy & MASK) << SHIFT) | (cx & MASK)
        if indices[tile, k] < 0:
            indices[tile, k] = count
            count += 1
        cell_of[i] = indices[tile, k]
    return count


@kernel
def list_coordinates(tiles, indices, coordinates):
    """Column and row of all cells, coordinates (cells, 2) out."""
    for ty in range(tiles.shape[0]):
        for tx in range(tiles.shape[1]):
            if tiles[ty, tx] >= 0:
                for k in range(SIDE * SIDE):
                    cell = indices[tiles[ty, tx], k]
                    if cell >= 0:
                        coordinates[cell, 0] = (tx << SHIFT) + (k & MASK)
                        coordinates[cell, 1] = (ty << SHIFT) + (k >> SHIFT)


@inlined
def cell_at(tiles, indices, cx, cy):
    """Number of the cell at column cx and row cy, which may lie outside; -1 where no end point lies."""
    inside = 0 <= cx < (tiles.shape[1] << SHIFT) and 0 <= cy < (tiles.shape[0] << SHIFT)
    tile = tiles[cy >> SHIFT, cx >> SHIFT] if inside else -1
    return indices[tile, ((cy & MASK) << SHIFT) | (cx & MASK)] if tile >= 0 else -1


@kernel
def cells_in_reach(x, y, cells, reach, out):
    """Cells within `reach` [m] of that of the point (x, y), out (m,) with room for all; returns their number."""
    tiles, indices = cells.tiles, cells.indices
    radius = int(np.ceil(reach / cells.side))
    cx = int(np.floor((x - cells.corner[0]) / cells.side))
    cy = int(np.floor((y - cells.corner[1]) / cells.side))
    count = 0
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            if dx * dx + dy * dy <= radius * radius:
                cell = cell_at(tiles, indices, cx + dx, cy + dy)
                if cell >= 0:
                    out[count] = cell
                    count += 1
    return count


@kernel
def list_candidates(points, cells, reach):
    """Surfels at points (surfels, 2) within `reach` [m] of each cell.

    Returns first (cells + 1,) and items: those of cell i are items[first[i] : first[i + 1]].
    """
    radius = int(np.ceil(reach / cells.side))
    near = np.empty((2 * radius + 1) ** 2, np.int64)
    first = np.zeros(cells.coordinates.shape[0] + 1, np.int64)
    for surfel in range(points.shape[0]):
        for k in range(cells_in_reach(points[surfel, 0], points[surfel, 1], cells, reach, near)):
            first[near[k] + 1] += 1
    for i in range(1, first.shape[0]):
        first[i] += first[i - 1]
    free, items = first[:-1].copy(), np.empty(first[-1], np.int32)
    for surfel in range(points.shape[0]):
        for k in range(cells_in_reach(points[surfel, 0], points[surfel, 1], cells, reach, near)):
            items[free[near[k]]] = surfel
            free[near[k]] += 1
    return first, items
