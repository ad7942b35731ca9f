# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the maps: what a scan does to counts, walls, sub-cell surface and the lines that walls form.

Inner loops work on arrays taken out of the tuples beforehand and call only functions of plain numbers or inlined ones:
a call that passes arrays counts references, which made these loops five times slower.
"""

from __future__ import annotations

import numpy as np

from slam._jit import inlined, kernel
from slam._planar_kernels import principal_axes
from slam.grid._cell_kernels import (
    DIRECTION,
    HITS,
    counted,
    halved,
    hits_of,
    is_full,
    mean_x,
    mean_y,
    packed,
    packed_x,
    packed_y,
    with_end_point,
)
from slam.grid._tile_kernels import FINE_SHIFT, MASK, SHIFT, fine_tile_at, in_fine_tile, in_tile, request_tile, tile_at
from slam.grid._traversal_kernels import count_misses, rays_in_cells, tiles_on_rays
from slam.grid._wall_kernels import flip_walls

LINE_REACH = 2
"""Half side of the square of cells in which a line is fitted [cells]."""
LINE_SIDE = 2 * LINE_REACH + 1
"""Side of that square."""
ROW_CELLS = np.array(
    [
        [k for k in range(LINE_SIDE) if row >> k & 1] + [0] * (LINE_SIDE - row.bit_count())
        for row in range(1 << LINE_SIDE)
    ]
)
"""Places of the walls in a row of the square, by the bits of the row, filled up with 0."""
ROW_WALLS = np.array([row.bit_count() for row in range(1 << LINE_SIDE)])
"""Their number."""
LINE_FLATNESS = 0.1
"""Walls form a line where their variance across it is at most this share of that along it."""


@kernel
def tiles_beside_hits(table, segments, hit, tiles, count, seen):
    """Add the tiles of the cells about each hit that are not empty to a list that holds those of the hits.

    table (rows, columns) of one particle, segments (beams, 4) in cells;  tiles, count, seen: see `request_tile`
    """
    columns = table.shape[1]
    for beam in range(segments.shape[0]):
        cx, cy = int(segments[beam, 2]), int(segments[beam, 3])
        inside_x, inside_y = cx & MASK, cy & MASK
        if not hit[beam] or (0 < inside_x < MASK and 0 < inside_y < MASK):
            continue
        for y in range((cy - 1) >> SHIFT, ((cy + 1) >> SHIFT) + 1):
            for x in range((cx - 1) >> SHIFT, ((cx + 1) >> SHIFT) + 1):
                if table[y, x] != 0:
                    count = request_tile(y * columns + x, tiles, count, seen)
    return count


@kernel
def request_scan_tiles(start, stop, grids, poses, rays, crossed, ended):
    """List the tiles that the beams cross and those in which they hit, for particles [start, stop).

    Also those with cells beside a hit, where anything is known there: a hit may outdo walls beside it.

    poses (particles, 3);  crossed, ended: `TileRequest`s of the counts and of the surface
    """
    columns, fine_columns, hit = grids.table.shape[2], grids.surface_table.shape[2], rays.hit
    segments = np.empty((hit.shape[0], 4))
    for particle in range(start, stop):
        rays_in_cells(grids, poses[particle], rays, segments)
        crossed.count[particle] = tiles_on_rays(
            segments, columns, crossed.tiles[particle], crossed.count[particle], crossed.seen[particle]
        )
        crossed.count[particle] = tiles_beside_hits(
            grids.table[particle],
            segments,
            hit,
            crossed.tiles[particle],
            crossed.count[particle],
            crossed.seen[particle],
        )
        tiles, seen, count = ended.tiles[particle], ended.seen[particle], ended.count[particle]
        for beam in range(segments.shape[0]):
            if hit[beam]:
                place = (int(segments[beam, 3]) >> FINE_SHIFT) * fine_columns + (int(segments[beam, 2]) >> FINE_SHIFT)
                count = request_tile(place, tiles, count, seen)
        ended.count[particle] = count


@inlined
def fade_neighbours(table, counts, walls, cx, cy):
    """Halve the counts of the cells about a full one, which is halved next, where they would outdo it then.

    table (rows, columns), counts (tiles, SIDE * SIDE) and walls (tiles, SIDE) of `GridArrays`, for one particle
    Walls are left alone: along a wall many cells are full at a time, and each would halve the others.
    """
    for k in range(9):
        x, y = cx - 1 + k % 3, cy - 1 + k // 3
        tile, inside = tile_at(table, x, y), in_tile(x, y)
        word = counts[tile, inside]
        is_wall = (walls[tile, np.uint64(y & MASK)] >> np.uint32(x & MASK)) & np.uint32(1)
        if is_wall == 0 and 2 * hits_of(word) > HITS:
            counts[tile, inside] = halved(word)


@kernel
def count_hits(table, counts, walls, surface_table, surface, segments, hit, passed, n):
    """Count what happened in the last cell of each beam: a hit or a pass; hits move the cell's mean end point.

    As in `count_misses`; appends the cells of passes to passed from n on and returns the new number of entries.
    """
    for beam in range(segments.shape[0]):
        x, y = segments[beam, 2], segments[beam, 3]
        cx, cy = int(x), int(y)
        tile, k = tile_at(table, cx, cy), in_tile(cx, cy)
        if hit[beam] and is_full(counts[tile, k]):
            fade_neighbours(table, counts, walls, cx, cy)
        word = counted(counts[tile, k], 1 if hit[beam] else 0)
        counts[tile, k] = word
        if hit[beam]:
            tile, k = fine_tile_at(surface_table, cx, cy), in_fine_tile(cx, cy)
            surface[tile, k] = with_end_point(surface[tile, k], hits_of(word), x - cx, y - cy)
        elif n < passed.shape[0]:
            passed[n] = packed(cx, cy)
            n += 1
    return n


@inlined
def bits_between(low, high, left, right):
    """Bits of the cells [left, right] of a row, fewer than 17, of which the tiles' wall words are low and high (which
    are the same word where both cells lie in one tile); bit 0 is that of the cell `left`."""
    both = np.uint32(low) | (np.uint32(high) << np.uint32(16))
    return (both >> np.uint32(left & MASK)) & ((np.uint32(2) << np.uint32(right - left)) - np.uint32(1))


@inlined
def walls_about(table, walls, cx, cy, found):
    """List the walls within `LINE_REACH` cells of a cell as `packed`, row by row: found (m,); returns their number.

    Without a branch: where the walls about a cell lie cannot be guessed. Each row writes all places of `ROW_CELLS`, and
    the next row begins after the last one that counts.
    """
    rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
    left, right = max(cx - LINE_REACH, 0), min(cx + LINE_REACH, columns - 1)
    n = 0
    for y in range(max(cy - LINE_REACH, 0), min(cy + LINE_REACH + 1, rows)):
        row, first = np.uint64(y & MASK), packed(left, y)
        bits = np.uint64(
            bits_between(walls[tile_at(table, left, y), row], walls[tile_at(table, right, y), row], left, right)
        )
        for k in range(LINE_SIDE):
            found[np.uint64(n + k)] = first + ROW_CELLS[bits, np.uint64(k)]
        n += ROW_WALLS[bits]
    return n


@inlined
def moments_of_walls(surface_table, surface, cx, cy, found, n):
    """Sums x, y, xx, xy, yy of the mean end points of the walls found (n,), counted from a cell's corner [cells]."""
    sx, sy, sxx, sxy, syy = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        x, y = packed_x(found[np.uint64(k)]), packed_y(found[np.uint64(k)])
        word = surface[fine_tile_at(surface_table, x, y), in_fine_tile(x, y)]
        mx, my = mean_x(word) + (x - cx), mean_y(word) + (y - cy)
        sx += mx
        sy += my
        sxx += mx * mx
        sxy += mx * my
        syy += my * my
    return sx, sy, sxx, sxy, syy


@inlined
def line_direction(n, sx, sy, sxx, sxy, syy):
    """Direction code of the line that n walls form, from the sums of their mean end points; 0 where they form none.

    The smaller principal axis of the mean end points, if its variance is at most `LINE_FLATNESS` of the larger one.
    """
    if n < 3:
        return np.uint32(0)
    cxx, cxy, cyy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
    along, smaller, larger = principal_axes(cxx, cxy, cyy)
    if smaller > LINE_FLATNESS * larger:
        return np.uint32(0)
    turn = (along / np.pi + 0.5) % 1.0  # the normal, in half turns
    return np.uint32(1) + np.uint32(min(int(turn * 255.0), 254))


@kernel
def refresh_lines(table, walls, surface_table, surface, segments, hit):
    """Fit the line direction of every cell in which a beam has just ended."""
    found = np.empty(LINE_SIDE * LINE_SIDE + LINE_SIDE, np.int64)
    last_x, last_y = -1, -1
    for beam in range(segments.shape[0]):
        cx, cy = int(segments[beam, 2]), int(segments[beam, 3])
        if hit[beam] and not (cx == last_x and cy == last_y):
            last_x, last_y = cx, cy
            n = walls_about(table, walls, cx, cy, found)
            sx, sy, sxx, sxy, syy = moments_of_walls(surface_table, surface, cx, cy, found, n)
            tile, k = fine_tile_at(surface_table, cx, cy), in_fine_tile(cx, cy)
            surface[tile, k] = (surface[tile, k] & ~DIRECTION) | line_direction(n, sx, sy, sxx, sxy, syy)


@kernel
def count_scan(start, stop, grids, poses, rays, share, changes):
    """Count one scan into the maps of particles [start, stop), each from its own pose; their tiles must be their own.

    poses (particles, 3);  share: see `is_wall`;  changes: `Changes`, overwritten
    """
    counts, walls, surface, hit = grids.counts, grids.walls, grids.surface, rays.hit
    segments = np.empty((hit.shape[0], 4))
    passed = np.empty(16 * changes.cells.shape[1], np.int64)
    for particle in range(start, stop):
        table, surface_table = grids.table[particle], grids.surface_table[particle]
        rays_in_cells(grids, poses[particle], rays, segments)
        n = count_misses(table, counts, segments, passed)
        n = count_hits(table, counts, walls, surface_table, surface, segments, hit, passed, n)
        changes.filled[particle] = flip_walls(
            table, counts, walls, passed[:n], segments, hit, share, changes.cells[particle]
        )
        refresh_lines(table, walls, surface_table, surface, segments, hit)
