# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the field of nearest walls, kept up to date where cells become walls or cease to be.

A word says where the nearest wall is: words number the offsets within the field's radius from the farthest, 1, to the
cell itself; 0 = no wall within the radius. Of two walls the one of the larger word is preferred: the closer; at a tie
the lower, then the left one, so that the field does not depend on the order in which walls come and go.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import kernel
from slam.grid._cell_kernels import packed_x, packed_y
from slam.grid._tile_kernels import MASK, SHIFT, SIDE, ask_for, in_tile, tile_at
from slam.grid._update_kernels import register_scans

FAR = 0
LARGEST_RADIUS = 63
"""[cells]; with at most 9 cells a word fits a byte."""


class Disc(NamedTuple):
    """The cells within the field's radius of a cell."""

    radius: int
    """[cells]."""
    half_width: NDArray[np.int64]
    """How far each row reaches to both sides [cells], (2 radius + 1,)."""
    word: NDArray[np.int64]
    """Word of the wall at an offset, [dy + radius, dx + radius]; 0 beyond the radius."""
    offset: NDArray[np.int64]
    """Offset dx, dy of each word, (words + 1, 2)."""


def disc_of(radius: int) -> Disc:
    """The disc of that radius [cells]."""
    rows = np.arange(-radius, radius + 1)
    dx, dy = np.meshgrid(rows, rows)
    distance2 = dx**2 + dy**2
    inside = distance2 <= radius**2
    order = np.lexsort((dx[inside], dy[inside], distance2[inside]))[::-1]
    offset = np.concatenate([np.zeros((1, 2), np.int64), np.stack([dx[inside], dy[inside]], axis=-1)[order]])
    word = np.zeros(dx.shape, np.int64)
    word[offset[1:, 1] + radius, offset[1:, 0] + radius] = np.arange(1, len(offset))
    return Disc(radius, np.sqrt(radius**2 - rows**2).astype(np.int64), word, offset)


@kernel
def demand_of_changes(start, stop, grids, changes, radius, demand):
    """List the field tiles within `radius` cells of changed cells, for particles [start, stop)."""
    rows, columns = grids.table.shape[1], grids.table.shape[2]
    width = columns << SHIFT
    for particle in range(start, stop):
        tiles, seen, count = demand.tiles[particle], demand.seen[particle], demand.count[particle]
        for j in range(changes.count[particle]):
            cx, cy = packed_x(changes.cells[particle, j]), packed_y(changes.cells[particle, j])
            for ty in range(max(cy - radius, 0) >> SHIFT, (min(cy + radius, rows * SIDE - 1) >> SHIFT) + 1):
                for tx in range(max(cx - radius, 0) >> SHIFT, (min(cx + radius, width - 1) >> SHIFT) + 1):
                    count = ask_for(ty * columns + tx, tiles, count, seen)
        demand.count[particle] = count


@kernel
def register_scans_and_ask(start, stop, grids, poses, rays, occupied_share, changes, radius, demand):
    """`register_scans`, and straight after it what `demand_of_changes` asks for: one loop over the particles."""
    register_scans(start, stop, grids, poses, rays, occupied_share, changes)
    demand_of_changes(start, stop, grids, changes, radius, demand)


@kernel
def spread_wall(table, nearest, cx, cy, disc):
    """Tell the cells within the field's radius about a new wall at (cx, cy)."""
    rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
    for y in range(max(cy - disc.radius, 0), min(cy + disc.radius + 1, rows)):
        half, words = disc.half_width[y - cy + disc.radius], disc.word[cy - y + disc.radius]
        x, last = max(cx - half, 0), min(cx + half, columns - 1)
        while x <= last:  # the parts of the row in one tile each
            tile, row = tile_at(table, x, y), (y & MASK) << SHIFT
            stop = min(last, x | MASK) + 1
            while x < stop:
                k = np.uint64(row | (x & MASK))
                nearest[tile, k] = max(np.int64(nearest[tile, k]), words[np.uint64(cx - x + disc.radius)])
                x += 1


@kernel
def orphans_of(table, nearest, cx, cy, disc, out):
    """Cells out (n, 2) as x, y whose word points to the wall at (cx, cy); returns n."""
    rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
    n = 0
    for y in range(max(cy - disc.radius, 0), min(cy + disc.radius + 1, rows)):
        half, words = disc.half_width[y - cy + disc.radius], disc.word[cy - y + disc.radius]
        x, last = max(cx - half, 0), min(cx + half, columns - 1)
        while x <= last:
            tile, row = tile_at(table, x, y), (y & MASK) << SHIFT
            stop = min(last, x | MASK) + 1
            while x < stop:
                if nearest[tile, np.uint64(row | (x & MASK))] == words[np.uint64(cx - x + disc.radius)]:
                    out[n, 0], out[n, 1] = x, y
                    n += 1
                x += 1
    return n


@kernel
def walls_between(table, walls, left, right, low, high, out):
    """Walls out (2, m) as x and y in the columns [left, right] and rows [low, high], row by row; returns m."""
    m = 0
    for y in range(low, high + 1):
        for tx in range(left >> SHIFT, (right >> SHIFT) + 1):
            x = tx << SHIFT
            bits = walls[tile_at(table, x, y), np.uint64(y & MASK)]
            while bits != 0:
                if (bits & np.uint16(1)) != 0 and left <= x <= right:
                    out[0, m], out[1, m] = x, y
                    m += 1
                bits >>= np.uint16(1)
                x += 1
    return m


@kernel
def adopt(table, nearest, orphans, candidates, disc):
    """Point the orphans (n, 2) to the nearest of the walls candidates (2, m), where one is within the radius."""
    radius, words = disc.radius, disc.word
    for j in range(orphans.shape[0]):
        x, y = orphans[j, 0] - radius, orphans[j, 1] - radius
        best = 0
        for w in range(candidates.shape[1]):
            dx, dy = candidates[0, w] - x, candidates[1, w] - y
            if 0 <= dx <= 2 * radius and 0 <= dy <= 2 * radius:
                best = max(best, words[np.uint64(dy), np.uint64(dx)])
        nearest[tile_at(table, x + radius, y + radius), in_tile(x + radius, y + radius)] = best


@kernel
def update_fields(start, stop, grids, changes, disc):
    """Bring the fields of particles [start, stop) up to date after `changes`; their tiles must be private.

    The result equals the field built from scratch: a cell that pointed to a vanished wall looks at all walls within
    the radius again.
    """
    radius = disc.radius
    orphans, candidates = np.empty(((2 * radius + 1) ** 2, 2), np.int64), np.empty((2, (4 * radius + 1) ** 2), np.int64)
    walls, nearest = grids.walls, grids.nearest
    for particle in range(start, stop):
        table, field_table = grids.table[particle], grids.field_table[particle]
        rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
        for j in range(changes.count[particle]):
            cx, cy = packed_x(changes.cells[particle, j]), packed_y(changes.cells[particle, j])
            if walls[tile_at(table, cx, cy), np.uint64(cy & MASK)] >> np.uint32(cx & MASK) & 1:
                spread_wall(field_table, nearest, cx, cy, disc)
                continue
            n = orphans_of(field_table, nearest, cx, cy, disc, orphans)
            if n > 0:
                left, right = orphans[:n, 0].min() - radius, orphans[:n, 0].max() + radius
                low, high = orphans[0, 1] - radius, orphans[n - 1, 1] + radius  # they come row by row
                m = walls_between(
                    table, walls, max(left, 0), min(right, columns - 1), max(low, 0), min(high, rows - 1), candidates
                )
                adopt(field_table, nearest, orphans[:n], candidates[:, :m], disc)
