# SPDX-License-Identifier: MIT
"""Compiled parts of the field of nearest walls, kept up to date where cells become walls or cease to be.

A word holds the offset to the nearest wall cell: bits 7..13 dy + 64, bits 0..6 dx + 64; 0 = none within the radius.
Of two walls the one of the lower key (squared distance, then word) is preferred: the closer; at a tie the lower, then
the left one, so that the field does not depend on the order in which walls come and go. The word 0 reads as an offset
of (-64, -64), farther than any wall within the radius, so that it needs no case of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._cell_kernels import packed_x, packed_y
from slam._jit import inlined, kernel
from slam._tile_kernels import MASK, SHIFT, SIDE, ask_for, in_tile, tile_at

FAR = 0
LARGEST_OFFSET = 63


class Disc(NamedTuple):
    """The cells within the field's radius of a cell."""

    radius: int
    """[cells]."""
    half_width: NDArray[np.int64]
    """How far each row reaches to both sides [cells], (2 radius + 1,)."""


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


@inlined
def word_of(dx, dy):
    """Field word of the wall at (dx, dy) from a cell."""
    return ((dy + 64) << 7) | (dx + 64)


@inlined
def key_of(dx, dy):
    """What walls are compared by."""
    return ((dx * dx + dy * dy) << 14) | word_of(dx, dy)


@inlined
def key_of_word(word):
    """The key of what a field word points to."""
    return key_of((word & 127) - 64, (word >> 7) - 64)


@kernel
def spread_wall(table, nearest, cx, cy, disc):
    """Tell the cells within the field's radius about a new wall at (cx, cy)."""
    rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
    for y in range(max(cy - disc.radius, 0), min(cy + disc.radius + 1, rows)):
        half = disc.half_width[y - cy + disc.radius]
        x, last = max(cx - half, 0), min(cx + half, columns - 1)
        while x <= last:  # the parts of the row in one tile each
            tile, row = tile_at(table, x, y), (y & MASK) << SHIFT
            stop = min(last, x | MASK) + 1
            while x < stop:
                k = np.uint64(row | (x & MASK))
                if key_of(cx - x, cy - y) < key_of_word(np.int64(nearest[tile, k])):
                    nearest[tile, k] = word_of(cx - x, cy - y)
                x += 1


@kernel
def orphans_of(table, nearest, cx, cy, disc, out):
    """Cells out (n, 2) as x, y whose word points to the wall at (cx, cy); returns n."""
    rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
    n = 0
    for y in range(max(cy - disc.radius, 0), min(cy + disc.radius + 1, rows)):
        half = disc.half_width[y - cy + disc.radius]
        x, last = max(cx - half, 0), min(cx + half, columns - 1)
        while x <= last:
            tile, row = tile_at(table, x, y), (y & MASK) << SHIFT
            stop = min(last, x | MASK) + 1
            while x < stop:
                if nearest[tile, np.uint64(row | (x & MASK))] == word_of(cx - x, cy - y):
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
def adopt(table, nearest, orphans, candidates, radius):
    """Point the orphans (n, 2) to the nearest of the walls candidates (2, m), where one is within the radius."""
    beyond = (radius * radius + 1) << 14
    for j in range(orphans.shape[0]):
        x, y = orphans[j, 0], orphans[j, 1]
        best = beyond
        for w in range(candidates.shape[1]):
            best = min(best, key_of(candidates[0, w] - x, candidates[1, w] - y))
        nearest[tile_at(table, x, y), in_tile(x, y)] = best & 0x3FFF if best < beyond else FAR


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
                adopt(field_table, nearest, orphans[:n], candidates[:, :m], radius)
