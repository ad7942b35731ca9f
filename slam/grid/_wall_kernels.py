# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the maps: which cells are walls.

Two things make a cell a wall. Enough of the beams that reached it ended in it; and no cell beside it, across the wall,
holds more end points. The first alone puts walls too far from the robot: readings that are too short end in cells that
other beams cross, but only readings that are too long ever reach the cells behind a wall, and all of them end there.
"""

from __future__ import annotations

import numpy as np

from slam._jit import inlined, kernel
from slam.grid._cell_kernels import VISITS, hits_of, packed, packed_x, packed_y
from slam.grid._tile_kernels import MASK, in_tile, tile_at


@inlined
def has_enough_hits(word, share):
    """Whether at least this share of the beams that reached the cell ended in it."""
    hits = hits_of(word)
    return hits > 0 and hits >= share * (word & VISITS)


@inlined
def hits_at(table, counts, cx, cy):
    """Beams that ended in a cell."""
    return hits_of(counts[tile_at(table, cx, cy), in_tile(cx, cy)])


@inlined
def outdone_directions(table, counts, cx, cy, hits):
    """In how many of four directions one of the two neighbours of a cell outdoes it: holds more end points.

    The tables reach farther than the end points, by the field's radius: all neighbours lie in them.
    """
    directions = 0
    for k in range(4):
        dx, dy = min(k, 1), int(k == 0) + int(k == 2) - int(k == 3)  # up, right, up right, down right
        one, other = hits_at(table, counts, cx + dx, cy + dy), hits_at(table, counts, cx - dx, cy - dy)
        directions += int(hits < max(one, other))
    return directions


@inlined
def is_wall(table, counts, cx, cy, share):
    """Whether a cell of one particle's map is a wall, by its counts and those of its neighbours.

    share: that of the beams that reached the cell which must have ended in it
    The direction of the wall need not be known. Along a wall hits differ by chance, so a cell of it may be outdone in
    that one direction; a cell in front of the wall or behind it is outdone in the three others.
    """
    word = counts[tile_at(table, cx, cy), in_tile(cx, cy)]
    return has_enough_hits(word, share) & (outdone_directions(table, counts, cx, cy, hits_of(word)) < 2)


@kernel
def flip_walls(table, counts, walls, passed, segments, hit, share, changes):
    """Bring the walls of one particle up to date after a scan was counted.

    passed (n,): cells with hits that beams have gone through, which may have ceased to be walls
    segments (beams, 4), hit (beams,): cells in which beams have ended; they may have become walls, and may outdo walls
    beside them
    share: see `is_wall`;  changes (m,) out: cells that became a wall or ceased to be one, each once
    Returns their number.
    """
    changed = 0
    for j in range(passed.shape[0]):
        cx, cy = packed_x(passed[j]), packed_y(passed[j])
        tile, row, bit = tile_at(table, cx, cy), np.uint64(cy & MASK), np.uint32(1) << np.uint32(cx & MASK)
        stays = has_enough_hits(counts[tile, in_tile(cx, cy)], share)
        if (walls[tile, row] & bit) != 0 and not stays and changed < changes.shape[0]:
            walls[tile, row] ^= bit
            changes[changed] = passed[j]
            changed += 1
    last_x, last_y = -1, -1
    for beam in range(segments.shape[0]):
        ex, ey = int(segments[beam, 2]), int(segments[beam, 3])
        if not hit[beam] or (ex == last_x and ey == last_y):
            continue
        last_x, last_y = ex, ey
        hits = hits_at(table, counts, ex, ey)
        for k in range(9):
            cx, cy = ex - 1 + k % 3, ey - 1 + k // 3
            tile, row, bit = tile_at(table, cx, cy), np.uint64(cy & MASK), np.uint32(1) << np.uint32(cx & MASK)
            was = (walls[tile, row] & bit) != 0
            if k == 4 or (was and hits_of(counts[tile, in_tile(cx, cy)]) < hits):
                wall = is_wall(table, counts, cx, cy, share)
                if wall != was and changed < changes.shape[0]:
                    walls[tile, row] ^= bit
                    changes[changed] = packed(cx, cy)
                    changed += 1
    return changed
