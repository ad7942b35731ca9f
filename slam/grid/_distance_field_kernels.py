# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the field of nearest walls, kept up to date where cells become walls or cease to be.

A word says where the nearest wall is: words number the offsets within the field's radius from the farthest, 1, to the
cell itself; 0 = no wall within the radius. Of two walls the one of the larger word is preferred: the closer; at a tie
the lower, then the left one, so that the field does not depend on the order in which walls come and go.
"""

from __future__ import annotations

import numpy as np

from slam._jit import inlined, kernel
from slam.grid._cell_kernels import packed_x, packed_y
from slam.grid._tile_kernels import MASK, SHIFT, SIDE, in_tile, request_tile, tile_at
from slam.grid._update_kernels import count_scan

NOWHERE = 1 << 40
"""Above the number of any offset in `reassign_nearest`."""


@kernel
def request_field_tiles(start, stop, grids, changes, radius, request):
    """List the field tiles within `radius` cells of changed cells, for particles [start, stop)."""
    rows, columns = grids.table.shape[1], grids.table.shape[2]
    width = columns << SHIFT
    for particle in range(start, stop):
        tiles, seen, count = request.tiles[particle], request.seen[particle], request.count[particle]
        for j in range(changes.filled[particle]):
            cx, cy = packed_x(changes.cells[particle, j]), packed_y(changes.cells[particle, j])
            for ty in range(max(cy - radius, 0) >> SHIFT, (min(cy + radius, rows * SIDE - 1) >> SHIFT) + 1):
                for tx in range(max(cx - radius, 0) >> SHIFT, (min(cx + radius, width - 1) >> SHIFT) + 1):
                    count = request_tile(ty * columns + tx, tiles, count, seen)
        request.count[particle] = count


@kernel
def integrate_scan_and_request_field_tiles(start, stop, grids, poses, rays, share, changes, radius, request):
    """Run `count_scan`, then `request_field_tiles`: one loop over the particles instead of two."""
    count_scan(start, stop, grids, poses, rays, share, changes)
    request_field_tiles(start, stop, grids, changes, radius, request)


@inlined
def point_cells_to_wall(table, cells, cx, cy, radius, about):
    """Point the cells within the field's radius to a new wall at (cx, cy), where no nearer wall is known.

    cells: the words of all tiles, one after the other;  about: `OffsetTable.about`, flat. Whole rows of tiles, in the
    order in which they lie in memory, so that the loop is compiled to vector instructions.
    """
    for ty in range(max(cy - radius, 0) >> SHIFT, min((cy + radius) >> SHIFT, table.shape[0] - 1) + 1):
        low, high = max(cy - radius, ty << SHIFT), min(cy + radius, (ty << SHIFT) | MASK)
        for tx in range(max(cx - radius, 0) >> SHIFT, min((cx + radius) >> SHIFT, table.shape[1] - 1) + 1):
            first = (np.int64(table[ty, tx]) << (2 * SHIFT)) + ((low & MASK) << SHIFT)
            left = (tx << SHIFT) - cx + radius + MASK
            start = (left * (2 * radius + 1) + low - cy + radius) << SHIFT
            length = (high - low + 1) << SHIFT
            known, words = cells[first : first + length], about[start : start + length]
            for k in range(length):
                known[k] = max(known[k], words[k])


@kernel
def cells_pointing_to(table, nearest, cx, cy, offsets, out):
    """Cells out (n, 2) as x, y whose word points to the wall at (cx, cy); returns n."""
    rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
    n = 0
    for y in range(max(cy - offsets.radius, 0), min(cy + offsets.radius + 1, rows)):
        half, words = offsets.half_width[y - cy + offsets.radius], offsets.word[cy - y + offsets.radius]
        x, last = max(cx - half, 0), min(cx + half, columns - 1)
        while x <= last:
            tile, row = tile_at(table, x, y), (y & MASK) << SHIFT
            stop = min(last, x | MASK) + 1
            while x < stop:
                if nearest[tile, np.uint64(row | (x & MASK))] == words[np.uint64(cx - x + offsets.radius)]:
                    out[n, 0], out[n, 1] = x, y
                    n += 1
                x += 1
    return n


@kernel
def walls_between(table, walls, left, right, low, high, xs, ys):
    """Walls xs, ys (m,) in the columns [left, right] and rows [low, high], row by row; returns m."""
    m = 0
    for y in range(low, high + 1):
        for tx in range(left >> SHIFT, (right >> SHIFT) + 1):
            x = tx << SHIFT
            bits = walls[tile_at(table, x, y), np.uint64(y & MASK)]
            while bits != 0:
                if (bits & np.uint16(1)) != 0 and left <= x <= right:
                    xs[m], ys[m] = x, y
                    m += 1
                bits >>= np.uint16(1)
                x += 1
    return m


@kernel
def reassign_nearest(table, nearest, cells, xs, ys, offsets):
    """Point the cells (n, 2) to the nearest of the walls at xs, ys (m,), where one is within the radius.

    The order of the words as numbers, the smallest of which is sought: the square of the distance, then dy, then dx.
    """
    radius, words = offsets.radius, offsets.word
    for j in range(cells.shape[0]):
        x, y = cells[j, 0], cells[j, 1]
        best = NOWHERE
        for w in range(xs.shape[0]):
            dx, dy = xs[w] - x, ys[w] - y
            best = min(best, ((dx * dx + dy * dy) << 14) + (dy << 7) + dx)
        word = 0
        if (best + 64 * 128 + 64) >> 14 <= radius * radius:
            dx = ((best + 64) & 127) - 64
            dy = (((best - dx) >> 7) + 64 & 127) - 64
            word = words[np.uint64(dy + radius), np.uint64(dx + radius)]
        nearest[tile_at(table, x, y), in_tile(x, y)] = word


@kernel
def update_fields(start, stop, grids, changes, offsets):
    """Bring the fields of particles [start, stop) up to date after `changes`; their tiles must be private.

    The result equals the field built from scratch: a cell that pointed to a vanished wall looks at all walls within
    the radius again.
    """
    radius = offsets.radius
    cells, room = np.empty(((2 * radius + 1) ** 2, 2), np.int64), (4 * radius + 1) ** 2
    xs, ys = np.empty(room, np.int64), np.empty(room, np.int64)
    walls, nearest, flat, about = grids.walls, grids.nearest, grids.nearest.ravel(), offsets.about.ravel()
    for particle in range(start, stop):
        table, field_table = grids.table[particle], grids.field_table[particle]
        rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
        for j in range(changes.filled[particle]):
            cx, cy = packed_x(changes.cells[particle, j]), packed_y(changes.cells[particle, j])
            if walls[tile_at(table, cx, cy), np.uint64(cy & MASK)] >> np.uint32(cx & MASK) & 1:
                point_cells_to_wall(field_table, flat, cx, cy, radius, about)
                continue
            n = cells_pointing_to(field_table, nearest, cx, cy, offsets, cells)
            if n > 0:
                left, right = cells[:n, 0].min() - radius, cells[:n, 0].max() + radius
                low, high = cells[0, 1] - radius, cells[n - 1, 1] + radius  # they come row by row
                m = walls_between(
                    table, walls, max(left, 0), min(right, columns - 1), max(low, 0), min(high, rows - 1), xs, ys
                )
                reassign_nearest(field_table, nearest, cells[:n], xs[:m], ys[:m], offsets)
