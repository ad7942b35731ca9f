# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled part of the final map: end points moved onto the walls that they belong to."""

from __future__ import annotations

import numpy as np

from slam._jit import kernel
from slam.refinement._cell_index_kernels import cell_at
from slam.refinement._surfel_match_kernels import MIN_COSINE

SNAP_SIGMAS = 4.0
"""How many standard deviations of the noise an end point may lie from its wall: of many thousands some lie far off, and
one that is left behind the wall opens it."""


@kernel
def move_onto_walls(start, stop, placed, ranges, cells, surfels, noise, spacing, gate, depth):
    """Move the end points in [start, stop) onto their surfels, and `depth` [m] into the wall; placed is changed.

    cells: those in which the surfels were found. An end point belongs to the most probable of the surfels that face
    where it was seen from, on a piece of wall `spacing` [m] long to both sides, no farther across than `gate` [m] plus
    `SNAP_SIGMAS` standard deviations of the noise. A surfel that many readings have seen is more
    probable: readings that are too long, and form a line of their own behind a wall, come to the wall.
    """
    points, view_directions = placed.points, placed.view_directions
    point, normal, seen, first, items = surfels.point, surfels.normal, surfels.weight, surfels.first, surfels.items
    for i in range(start, stop):
        x, y = points[i, 0], points[i, 1]
        cx, cy = np.floor((x - cells.corner[0]) / cells.side), np.floor((y - cells.corner[1]) / cells.side)
        cell = cell_at(cells.tiles, cells.indices, int(cx), int(cy))
        if cell < 0:
            continue
        r2, most, to_x, to_y = ranges[i] * ranges[i], 0.0, 0.0, 0.0
        floor, across_beam = noise.floor + noise.shared, noise.across * r2
        along_beam = noise.along * r2 - across_beam  # what its variance exceeds that across the beam by
        for k in range(first[cell], first[cell + 1]):
            e = items[k]
            nx, ny = normal[e, 0], normal[e, 1]
            cosine = nx * view_directions[i, 0] + ny * view_directions[i, 1]
            dx, dy = x - point[e, 0], y - point[e, 1]
            across = nx * dx + ny * dy
            variance = floor + across_beam + along_beam * cosine * cosine
            bound = gate + SNAP_SIGMAS * np.sqrt(variance)
            if cosine < MIN_COSINE or abs(nx * dy - ny * dx) > spacing or abs(across) > bound:
                continue
            probability = seen[e] * np.exp(-0.5 * across * across / variance)
            if probability > most:
                most = probability
                to_x = (floor + across_beam) * nx + along_beam * cosine * view_directions[i, 0]
                to_y = (floor + across_beam) * ny + along_beam * cosine * view_directions[i, 1]
                to_x, to_y = to_x * across / variance + depth * nx, to_y * across / variance + depth * ny
        points[i, 0], points[i, 1] = x - to_x, y - to_y
