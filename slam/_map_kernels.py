# SPDX-License-Identifier: MIT
"""Compiled parts of the maps: ray traversal, counting and sub-cell surface.

Each cell keeps a 16-bit word of counts and a 32-bit word of surface in one pool (and one of the field, see
`_field_kernels`, in another):

    counts   bit 15 wall flag | bits 9..14 hits | bits 0..8 visits (hits + beams that passed)
    surface  bits 20..31 mean x | bits 8..19 mean y of the end points, in 1/4096 of a cell | bits 0..7 line direction

Inner loops work on arrays taken out of the tuples beforehand and call only functions of plain numbers: a call that
passes arrays counts references, which made these loops five times slower.

The line direction is 0 where the neighbouring walls form no line, else 1 + 255 * angle / pi of the wall's normal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import inlined, kernel
from slam._tile_kernels import MASK, SHIFT

WALL = np.uint32(1 << 15)
HIT_SHIFT = np.uint32(9)
HITS = np.uint32(0x3F)
VISITS = np.uint32(0x1FF)
LINE_REACH = 2
LINE_FLATNESS = 0.1
MEAN_MEMORY = 32
"""The mean of a cell's end points forgets slowly: the gain of a new one never falls below 1 / MEAN_MEMORY."""


class Grids(NamedTuple):
    """The maps of all particles."""

    table: NDArray[np.int32]
    """Tile numbers in `counts` and `surface`, (particles, rows, columns)."""
    counts: NDArray[np.uint16]
    """(tiles, SIDE * SIDE)."""
    surface: NDArray[np.uint32]
    """(tiles, SIDE * SIDE)."""
    field_table: NDArray[np.int32]
    """Tile numbers in `nearest`, (particles, rows, columns)."""
    nearest: NDArray[np.int16]
    """Field words, see `_field_kernels`, (tiles, SIDE * SIDE)."""
    corner: NDArray[np.int64]
    """Cell number in x and in y of the tables' corner, counted from the map's origin, (2,)."""
    cell: float
    """Side of a cell [m]."""
    per_cell: float
    """1 / cell [1/m]."""


class Rays(NamedTuple):
    """The beams of one scan in the robot's frame at the time of the scan."""

    origins: NDArray[np.float64]
    """Where each beam starts [m], (beams, 2)."""
    ends: NDArray[np.float64]
    """Where each beam ends [m], (beams, 2)."""
    hit: NDArray[np.bool_]
    """Whether it ended on something, (beams,)."""


@kernel
def rays_in_cells(grids, pose, rays, out):
    """Start and end of all beams in cells from the tables' corner, out (beams, 4), for the robot at `pose` (3,)."""
    cos, sin = np.cos(pose[2]) * grids.per_cell, np.sin(pose[2]) * grids.per_cell
    x, y = pose[0] * grids.per_cell - grids.corner[0], pose[1] * grids.per_cell - grids.corner[1]
    origins, ends = rays.origins, rays.ends
    for beam in range(ends.shape[0]):
        out[beam, 0] = x + cos * origins[beam, 0] - sin * origins[beam, 1]
        out[beam, 1] = y + sin * origins[beam, 0] + cos * origins[beam, 1]
        out[beam, 2] = x + cos * ends[beam, 0] - sin * ends[beam, 1]
        out[beam, 3] = y + sin * ends[beam, 0] + cos * ends[beam, 1]


@kernel
def tiles_on_rays(segments, columns, tiles, count, seen):
    """Append the places in the table of all tiles that the segments (beams, 4) cross to tiles (m,), each once.

    Tile borders are crossed in the order in which `count_misses` crosses them: the same products are compared.
    Returns the new count; seen (m,) marks the places that are in the list.
    """
    for beam in range(segments.shape[0]):
        x0, y0, x1, y1 = segments[beam, 0], segments[beam, 1], segments[beam, 2], segments[beam, 3]
        tx, ty = int(x0) >> SHIFT, int(y0) >> SHIFT
        left_x, left_y = abs((int(x1) >> SHIFT) - tx), abs((int(y1) >> SHIFT) - ty)
        step_x, step_y = (1 if x1 > x0 else -1), (1 if y1 > y0 else -1)
        side_x, side_y = (1 if x1 > x0 else 0), (1 if y1 > y0 else 0)
        per_x = 1.0 / (x1 - x0) if left_x > 0 else 0.0
        per_y = 1.0 / (y1 - y0) if left_y > 0 else 0.0
        while True:
            place = ty * columns + tx
            if seen[place] == 0:
                seen[place] = 1
                tiles[count] = place
                count += 1
            if left_x == 0 and left_y == 0:
                break
            border_x, border_y = (tx + side_x) << SHIFT, (ty + side_y) << SHIFT
            if left_y == 0 or (left_x > 0 and (border_x - x0) * per_x < (border_y - y0) * per_y):
                tx += step_x
                left_x -= 1
            else:
                ty += step_y
                left_y -= 1
    return count


@kernel
def demand_of_rays(start, stop, grids, poses, rays, demand):
    """List the tiles that the beams cross, for particles [start, stop); poses (particles, 3)."""
    columns = grids.table.shape[2]
    segments = np.empty((rays.hit.shape[0], 4))
    for particle in range(start, stop):
        rays_in_cells(grids, poses[particle], rays, segments)
        demand.count[particle] = tiles_on_rays(
            segments, columns, demand.tiles[particle], demand.count[particle], demand.seen[particle]
        )


@inlined
def counted(word, hit):
    """The counts word after one more beam, a hit (1) or not (0); both counts are halved before either overflows."""
    visits = word & VISITS
    hits = (word >> HIT_SHIFT) & HITS
    if visits == VISITS or hits == HITS:
        visits, hits = visits >> np.uint32(1), hits >> np.uint32(1)
    return (word & WALL) | ((hits + np.uint32(hit)) << HIT_SHIFT) | (visits + np.uint32(1))


@inlined
def is_wall(word, occupied_share):
    """Whether at least `occupied_share` of the beams that reached the cell ended in it."""
    hits = (word >> HIT_SHIFT) & HITS
    return hits > 0 and hits >= occupied_share * (word & VISITS)


@inlined
def in_tile(cx, cy):
    """Index of a cell in its tile."""
    return ((cy & MASK) << SHIFT) | (cx & MASK)


@inlined
def packed(cx, cy):
    """One number for a cell."""
    return (np.int64(cy) << 32) | np.int64(cx)


@inlined
def packed_x(number):
    """Column of a packed cell."""
    return number & 0xFFFFFFFF


@inlined
def packed_y(number):
    """Row of a packed cell."""
    return number >> 32


@kernel
def count_misses(table, counts, segments, doubtful):
    """Count a miss in every cell that the beams cross before their last one (Amanatides and Woo, 1987).

    table (rows, columns) of one particle, counts (tiles, cells), segments (beams, 4) in cells
    doubtful (m,) out: cells as `packed` that hold hits, whose state may therefore change, repetitions included.
    A full list drops cells: they are looked at when next seen. Returns the number of entries.
    """
    n = 0
    for beam in range(segments.shape[0]):
        x0, y0, x1, y1 = segments[beam, 0], segments[beam, 1], segments[beam, 2], segments[beam, 3]
        cx, cy = int(x0), int(y0)
        left_x, left_y = abs(int(x1) - cx), abs(int(y1) - cy)
        step_x, step_y = (1 if x1 > x0 else -1), (1 if y1 > y0 else -1)
        side_x, side_y = (1 if x1 > x0 else 0), (1 if y1 > y0 else 0)
        per_x = 1.0 / (x1 - x0) if left_x > 0 else 0.0
        per_y = 1.0 / (y1 - y0) if left_y > 0 else 0.0
        time_x, time_y = (cx + side_x - x0) * per_x, (cy + side_y - y0) * per_y
        for _ in range(left_x + left_y):
            tile = table[cy >> SHIFT, cx >> SHIFT]
            k = in_tile(cx, cy)
            word = counts[tile, k]
            if word < VISITS:  # no hits, no overflow: the common case
                counts[tile, k] = word + np.uint32(1)
            else:
                counts[tile, k] = counted(word, 0)
                if n < doubtful.shape[0]:
                    doubtful[n] = packed(cx, cy)
                    n += 1
            if left_y == 0 or (left_x > 0 and time_x < time_y):
                cx += step_x
                left_x -= 1
                time_x = (cx + side_x - x0) * per_x
            else:
                cy += step_y
                left_y -= 1
                time_y = (cy + side_y - y0) * per_y
    return n


@inlined
def mean_x(surface):
    """Mean end point of a cell from its surface word: x in cells from the cell's corner."""
    return ((surface >> np.uint32(20)) + 0.5) * (1.0 / 4096.0)


@inlined
def mean_y(surface):
    """Mean end point of a cell from its surface word: y in cells from the cell's corner."""
    return (((surface >> np.uint32(8)) & np.uint32(0xFFF)) + 0.5) * (1.0 / 4096.0)


@inlined
def with_end_point(surface, hits, fx, fy):
    """Surface word after the `hits`-th end point at (fx, fy) in [0, 1) cells from the cell's corner."""
    gain = 1.0 / min(float(hits), float(MEAN_MEMORY))
    mx = mean_x(surface) + gain * (fx - mean_x(surface))
    my = mean_y(surface) + gain * (fy - mean_y(surface))
    x, y = np.uint32(min(max(mx, 0.0), 0.9999) * 4096.0), np.uint32(min(max(my, 0.0), 0.9999) * 4096.0)
    return (x << np.uint32(20)) | (y << np.uint32(8)) | (surface & np.uint32(0xFF))


@kernel
def count_hits(table, counts, surface, segments, hit, doubtful, n):
    """Count what happened in the last cell of each beam: a hit or a pass; hits move the cell's mean end point.

    As in `count_misses`; appends every last cell to doubtful from n on and returns the new number of entries.
    """
    for beam in range(segments.shape[0]):
        x, y = segments[beam, 2], segments[beam, 3]
        cx, cy = int(x), int(y)
        tile = table[cy >> SHIFT, cx >> SHIFT]
        k = in_tile(cx, cy)
        word = counted(counts[tile, k], 1 if hit[beam] else 0)
        counts[tile, k] = word
        if hit[beam]:
            surface[tile, k] = with_end_point(surface[tile, k], (word >> HIT_SHIFT) & HITS, x - cx, y - cy)
        if n < doubtful.shape[0]:
            doubtful[n] = packed(cx, cy)
            n += 1
    return n


@kernel
def flip_walls(table, counts, doubtful, n, occupied_share, changes):
    """Bring the wall flags of the first n doubtful cells up to date.

    changes (m,) out: cells whose flag changed, each once. Returns their number.
    """
    changed = 0
    for j in range(n):
        cx, cy = packed_x(doubtful[j]), packed_y(doubtful[j])
        tile = table[cy >> SHIFT, cx >> SHIFT]
        k = in_tile(cx, cy)
        word = counts[tile, k]
        if is_wall(word, occupied_share) != ((word & WALL) != 0) and changed < changes.shape[0]:
            counts[tile, k] = word ^ WALL
            changes[changed] = doubtful[j]
            changed += 1
    return changed


@kernel
def line_direction(table, counts, surface, cx, cy):
    """Direction code of the line that the walls about a cell form; 0 where they form none.

    The smaller principal axis of the mean end points within `LINE_REACH` cells, if its variance is at most
    `LINE_FLATNESS` of the larger one.
    """
    rows, columns = table.shape[0] << SHIFT, table.shape[1] << SHIFT
    n, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for y in range(max(cy - LINE_REACH, 0), min(cy + LINE_REACH + 1, rows)):
        for x in range(max(cx - LINE_REACH, 0), min(cx + LINE_REACH + 1, columns)):
            tile = table[y >> SHIFT, x >> SHIFT]
            k = in_tile(x, y)
            if counts[tile, k] & WALL:
                mx = mean_x(surface[tile, k]) + (x - cx)
                my = mean_y(surface[tile, k]) + (y - cy)
                n += 1
                sx += mx
                sy += my
                sxx += mx * mx
                sxy += mx * my
                syy += my * my
    if n < 3:
        return np.uint32(0)
    cxx, cxy, cyy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
    mid, half = 0.5 * (cxx + cyy), np.sqrt(0.25 * (cxx - cyy) ** 2 + cxy * cxy)
    if mid - half > LINE_FLATNESS * (mid + half):
        return np.uint32(0)
    along = 0.5 * np.arctan2(2.0 * cxy, cxx - cyy)  # of the larger axis
    turn = (along / np.pi + 0.5) % 1.0  # the normal, in half turns
    return np.uint32(1) + np.uint32(min(int(turn * 255.0), 254))


@kernel
def refresh_lines(table, counts, surface, segments, hit):
    """Fit the line direction of every cell in which a beam has just ended."""
    last_x, last_y = -1, -1
    for beam in range(segments.shape[0]):
        cx, cy = int(segments[beam, 2]), int(segments[beam, 3])
        if hit[beam] and not (cx == last_x and cy == last_y):
            last_x, last_y = cx, cy
            tile = table[cy >> SHIFT, cx >> SHIFT]
            k = in_tile(cx, cy)
            direction = line_direction(table, counts, surface, cx, cy)
            surface[tile, k] = (surface[tile, k] & np.uint32(0xFFFFFF00)) | direction


@kernel
def register_scans(start, stop, grids, poses, rays, occupied_share, changes, change_count):
    """Count one scan into the maps of particles [start, stop), each from its own pose; tiles must be private.

    changes (particles, m) out: cells as `packed` that became a wall or ceased to be one, each once;
    change_count (particles,) out.
    """
    counts, surface, hit = grids.counts, grids.surface, rays.hit
    segments = np.empty((hit.shape[0], 4))
    doubtful = np.empty(16 * changes.shape[1], np.int64)
    for particle in range(start, stop):
        table = grids.table[particle]
        rays_in_cells(grids, poses[particle], rays, segments)
        n = count_misses(table, counts, segments, doubtful)
        n = count_hits(table, counts, surface, segments, hit, doubtful, n)
        change_count[particle] = flip_walls(table, counts, doubtful, n, occupied_share, changes[particle])
        refresh_lines(table, counts, surface, segments, hit)
