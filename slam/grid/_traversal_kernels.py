# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled traversal of the grid by beams: which tiles they cross, and a miss for every cell on the way."""

from __future__ import annotations

import numpy as np

from slam._jit import kernel
from slam.grid._cell_kernels import VISITS, counted, packed
from slam.grid._tile_kernels import SHIFT, in_tile, request_tile, tile_at


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
def bounds_of_rays(poses, rays):
    """Smallest x, y and largest x, y [m] that robot and rays reach in the map from poses (particles, 3); NaN where a
    pose is not finite."""
    origins, ends = rays.origins, rays.ends
    left, low, right, high, total = np.inf, np.inf, -np.inf, -np.inf, 0.0
    for particle in range(poses.shape[0]):
        x, y = poses[particle, 0], poses[particle, 1]
        cos, sin = np.cos(poses[particle, 2]), np.sin(poses[particle, 2])
        left, right, low, high = min(left, x), max(right, x), min(low, y), max(high, y)
        total += x + y + cos
        for beam in range(ends.shape[0]):
            u0 = x + cos * origins[beam, 0] - sin * origins[beam, 1]
            v0 = y + sin * origins[beam, 0] + cos * origins[beam, 1]
            u1 = x + cos * ends[beam, 0] - sin * ends[beam, 1]
            v1 = y + sin * ends[beam, 0] + cos * ends[beam, 1]
            left, right = min(left, u0, u1), max(right, u0, u1)
            low, high = min(low, v0, v1), max(high, v0, v1)
    nothing = 0.0 * total  # NaN where one of them is not finite
    return left + nothing, low + nothing, right + nothing, high + nothing


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
            count = request_tile(ty * columns + tx, tiles, count, seen)
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
def count_misses(table, counts, segments, passed):
    """Count a miss in every cell that the beams cross before their last one (Amanatides and Woo, 1987).

    table (rows, columns) of one particle, counts (tiles, cells), segments (beams, 4) in cells
    passed (m,) out: those of the cells, as `packed`, that hold hits and may cease to be walls, with repetitions.
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
        border_x, border_y = float(cx + side_x), float(cy + side_y)  # as floats: no conversion in the loop
        time_x, time_y = (border_x - x0) * per_x, (border_y - y0) * per_y
        for _ in range(left_x + left_y):
            tile, k = tile_at(table, cx, cy), in_tile(cx, cy)
            word = counts[tile, k]
            if word < VISITS:  # no hits, no overflow: the common case
                counts[tile, k] = word + np.uint32(1)
            else:
                counts[tile, k] = counted(word, 0)
                if n < passed.shape[0]:
                    passed[n] = packed(cx, cy)
                    n += 1
            if left_y == 0 or (left_x > 0 and time_x < time_y):
                cx += step_x
                left_x -= 1
                border_x += step_x
                time_x = (border_x - x0) * per_x
            else:
                cy += step_y
                left_y -= 1
                border_y += step_y
                time_y = (border_y - y0) * per_y
    return n
