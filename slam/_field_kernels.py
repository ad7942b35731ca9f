# SPDX-License-Identifier: MIT
"""Compiled parts of the field of nearest walls, kept up to date where cells become walls or cease to be.

A word holds the offset to the nearest wall cell: bits 7..13 dy + 64, bits 0..6 dx + 64; 0 = none within the radius.
"""

from __future__ import annotations

import numpy as np

from slam._jit import inlined, kernel
from slam._map_kernels import WALL, in_tile, packed_x, packed_y
from slam._tile_kernels import SHIFT, SIDE

FAR = 0
LARGEST_OFFSET = 63


@kernel
def demand_of_changes(start, stop, grids, changes, change_count, radius, demand):
    """List the field tiles within `radius` cells of changed cells, for particles [start, stop)."""
    rows, columns = grids.table.shape[1], grids.table.shape[2]
    width = columns << SHIFT
    for particle in range(start, stop):
        for j in range(change_count[particle]):
            cx, cy = packed_x(changes[particle, j]), packed_y(changes[particle, j])
            for ty in range(max(cy - radius, 0) >> SHIFT, (min(cy + radius, rows * SIDE - 1) >> SHIFT) + 1):
                for tx in range(max(cx - radius, 0) >> SHIFT, (min(cx + radius, width - 1) >> SHIFT) + 1):
                    place = ty * columns + tx
                    if demand.seen[particle, place] == 0:
                        demand.seen[particle, place] = 1
                        demand.tiles[particle, demand.count[particle]] = place
                        demand.count[particle] += 1


@inlined
def nearer(dx, dy, other_dx, other_dy):
    """Whether the wall at (dx, dy) is to be preferred to another one: closer; at a tie the lower, then the left one,
    so that the field does not depend on the order in which walls come and go."""
    mine, other = dx * dx + dy * dy, other_dx * other_dx + other_dy * other_dy
    return mine < other or (mine == other and (dy < other_dy or (dy == other_dy and dx < other_dx)))


@kernel
def spread_wall(table, nearest, cx, cy, disc):
    """Tell the cells about a new wall of it; disc (n, 2) offsets (dx, dy) of the cells within the field's radius."""
    rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
    for j in range(disc.shape[0]):
        dx, dy = disc[j, 0], disc[j, 1]
        x, y = cx + dx, cy + dy
        if 0 <= x < columns and 0 <= y < rows:
            tile = table[y >> SHIFT, x >> SHIFT]
            k = in_tile(x, y)
            code = np.int64(nearest[tile, k])
            if code == FAR or nearer(-dx, -dy, (code & 127) - 64, (code >> 7) - 64):
                nearest[tile, k] = ((64 - dy) << 7) | (64 - dx)


@kernel
def walls_about(table, counts, cx, cy, reach, out):
    """Offsets (dx, dy) from (cx, cy) of the walls within a square of `reach` cells, out (n, 2); returns n."""
    rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
    n = 0
    for y in range(max(cy - reach, 0), min(cy + reach + 1, rows)):
        for x in range(max(cx - reach, 0), min(cx + reach + 1, columns)):
            if counts[table[y >> SHIFT, x >> SHIFT], in_tile(x, y)] & WALL:
                out[n, 0], out[n, 1] = x - cx, y - cy
                n += 1
    return n


@kernel
def forget_wall(table, nearest, cx, cy, disc, walls):
    """Point the cells whose nearest wall was the one at (cx, cy) to the nearest of the remaining `walls`.

    walls (n, 2) offsets from (cx, cy) of all walls that may be within the radius of such a cell
    """
    rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
    largest = disc[0, 0] ** 2 + disc[0, 1] ** 2
    for j in range(disc.shape[0]):
        largest = max(largest, disc[j, 0] ** 2 + disc[j, 1] ** 2)
    for j in range(disc.shape[0]):
        dx, dy = disc[j, 0], disc[j, 1]
        x, y = cx + dx, cy + dy
        if not (0 <= x < columns and 0 <= y < rows):
            continue
        tile = table[y >> SHIFT, x >> SHIFT]
        k = in_tile(x, y)
        if nearest[tile, k] != (((64 - dy) << 7) | (64 - dx)):
            continue
        best_x, best_y = LARGEST_OFFSET + 1, LARGEST_OFFSET + 1
        for w in range(walls.shape[0]):
            if nearer(walls[w, 0] - dx, walls[w, 1] - dy, best_x, best_y):
                best_x, best_y = walls[w, 0] - dx, walls[w, 1] - dy
        if best_x * best_x + best_y * best_y <= largest:
            nearest[tile, k] = ((best_y + 64) << 7) | (best_x + 64)
        else:
            nearest[tile, k] = FAR


@kernel
def update_fields(start, stop, grids, changes, change_count, disc, radius):
    """Bring the fields of particles [start, stop) up to date after `changes`; their tiles must be private.

    The result equals the field built from scratch: whatever is nearest to a cell that pointed to a vanished wall lies
    within twice the radius of that wall.
    """
    walls = np.empty(((4 * radius + 1) ** 2, 2), np.int64)
    for particle in range(start, stop):
        table, field_table = grids.table[particle], grids.field_table[particle]
        for j in range(change_count[particle]):
            cx, cy = packed_x(changes[particle, j]), packed_y(changes[particle, j])
            if grids.counts[table[cy >> SHIFT, cx >> SHIFT], in_tile(cx, cy)] & WALL:
                spread_wall(field_table, grids.nearest, cx, cy, disc)
            else:
                n = walls_about(table, grids.counts, cx, cy, 2 * radius, walls)
                forget_wall(field_table, grids.nearest, cx, cy, disc, walls[:n])
