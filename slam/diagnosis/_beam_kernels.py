# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled comparison of beams with a map: does each beam end where the map has a wall, and cross none before?"""

from __future__ import annotations

import numpy as np

from slam._jit import kernel
from slam.grid._cell_kernels import DIRECTION, NO_WALL, VISITS, hits_of, mean_x, mean_y
from slam.grid._tile_kernels import SHIFT, fine_tile_at, in_fine_tile, in_tile, tile_at
from slam.grid._traversal_kernels import rays_in_cells
from slam.grid._wall_kernels import has_enough_hits
from slam.matching._likelihood_kernels import HALF_LENGTH, NORMALS

UNKNOWN, MET, THROUGH, SHORT = 0, 1, 2, 3
"""What the map says of a beam: nothing; it ends at a wall; it crosses a wall; it ends in free space."""


@kernel
def crosses_wall(table, counts, surface_table, surface, limits, segment):
    """Whether a beam, segment (4,) in cells, crosses a piece of wall farther than the clearance before its end.

    limits: `BeamLimits`. The wall must have a direction. The end of the beam must lie farther from the wall's line than
    the clearance, its start farther than half of it: a beam that grazes a wall crosses none.
    """
    clear = limits.clearance
    x0, y0, x1, y1 = segment[0], segment[1], segment[2], segment[3]
    length = np.sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0))
    if length <= 1.5 * clear:
        return False
    ux, uy = (x1 - x0) / length, (y1 - y0) / length
    width, height = float(table.shape[1] << SHIFT), float(table.shape[0] << SHIFT)
    last_x, last_y = -1, -1
    for k in range(int(2.0 * (length - clear))):  # steps of half a cell
        x, y = x0 + 0.5 * k * ux, y0 + 0.5 * k * uy
        cx, cy = int(x), int(y)
        if (cx == last_x and cy == last_y) or not (0.0 <= x < width and 0.0 <= y < height):
            continue
        last_x, last_y = cx, cy
        word = counts[tile_at(table, cx, cy), in_tile(cx, cy)]
        if hits_of(word) < limits.min_hits or not has_enough_hits(word, limits.occupied_share):
            continue
        piece = surface[fine_tile_at(surface_table, cx, cy), in_fine_tile(cx, cy)]
        direction = np.uint64(piece & DIRECTION)
        if direction == 0:
            continue
        nx, ny = NORMALS[direction, 0], NORMALS[direction, 1]
        mx, my = cx + mean_x(piece), cy + mean_y(piece)
        start, end = nx * (x0 - mx) + ny * (y0 - my), nx * (x1 - mx) + ny * (y1 - my)
        if start * end >= 0.0 or abs(start) < 0.5 * clear or abs(end) < clear:
            continue
        at = start / (start - end)
        along = nx * (y0 + at * (y1 - y0) - my) - ny * (x0 + at * (x1 - x0) - mx)
        if abs(along) <= HALF_LENGTH:
            return True
    return False


@kernel
def compare_beams(grids, particle, pose, rays, every, first, limits, kinds, normals):
    """What the map of a particle says of every k-th beam, from beam `first` on, of a scan taken at `pose` (3,).

    limits: `BeamLimits`;  kinds (beams,) out: one of the four above, of beams that are not compared UNKNOWN
    normals (3,) out: elements xx, xy and yy of the sum of n n^T over the beams that end at a piece of wall of normal n;
    walls without a direction are left out
    """
    clear2 = limits.clearance * limits.clearance
    table, counts = grids.table[particle], grids.counts
    surface_table, surface = grids.surface_table[particle], grids.surface
    field_table, nearest, offset = grids.field_table[particle], grids.nearest, grids.offset
    width, height = float(table.shape[1] << SHIFT), float(table.shape[0] << SHIFT)
    segments = np.empty((rays.hit.shape[0], 4))
    rays_in_cells(grids, pose, rays, segments)
    kinds[:] = UNKNOWN
    normals[:] = 0.0
    for beam in range(first, rays.hit.shape[0], every):
        if not rays.hit[beam]:
            continue
        if crosses_wall(table, counts, surface_table, surface, limits, segments[beam]):
            kinds[beam] = THROUGH
            continue
        x, y = segments[beam, 2], segments[beam, 3]
        if not (0.0 <= x < width and 0.0 <= y < height):
            continue
        cx, cy = int(x), int(y)
        word = np.uint64(nearest[tile_at(field_table, cx, cy), in_tile(cx, cy)])
        if word != NO_WALL:
            dx, dy = float(offset[word, 0]), float(offset[word, 1])
            if dx * dx + dy * dy <= clear2:
                kinds[beam] = MET
                mx, my = cx + offset[word, 0], cy + offset[word, 1]
                direction = np.uint64(surface[fine_tile_at(surface_table, mx, my), in_fine_tile(mx, my)] & DIRECTION)
                nx, ny = NORMALS[direction, 0], NORMALS[direction, 1]  # zero where there is none
                normals[0] += nx * nx
                normals[1] += nx * ny
                normals[2] += ny * ny
                continue
        seen = counts[tile_at(table, cx, cy), in_tile(cx, cy)]
        if (seen & VISITS) >= limits.min_visits and not has_enough_hits(seen, limits.occupied_share):
            kinds[beam] = SHORT


@kernel
def beam_log_likelihoods(grids, particle, pose, rays, every, first, window, model, out):
    """Log-probability of every k-th beam, from beam `first` on, to end within the window of where it ended [nats].

    The beam passes or ends in each cell with the share of earlier beams that ended there (Thrun, Burgard, Fox 2005,
    section 9.2). window [cells] to both sides;  model: `RangeModel`;  out (beams,), of other beams unchanged
    """
    table, counts = grids.table[particle], grids.counts
    width, height = float(table.shape[1] << SHIFT), float(table.shape[0] << SHIFT)
    segments = np.empty((rays.hit.shape[0], 4))
    rays_in_cells(grids, pose, rays, segments)
    for beam in range(first, rays.hit.shape[0], every):
        if not rays.hit[beam]:
            continue
        x0, y0 = segments[beam, 0], segments[beam, 1]
        dx, dy = segments[beam, 2] - x0, segments[beam, 3] - y0
        length = max(np.sqrt(dx * dx + dy * dy), 1e-9)
        passes, ends = 1.0, 0.0
        last_x, last_y = -1, -1
        for k in range(int(2.0 * (length + window)) + 1):  # steps of half a cell
            x, y = x0 + 0.5 * k * dx / length, y0 + 0.5 * k * dy / length
            cx, cy = int(np.floor(x)), int(np.floor(y))
            if cx == last_x and cy == last_y:
                continue
            last_x, last_y = cx, cy
            hits, visits = 0.0, 0.0
            if 0.0 <= x < width and 0.0 <= y < height:
                word = counts[tile_at(table, cx, cy), in_tile(cx, cy)]
                hits, visits = float(hits_of(word)), float(word & VISITS)
            share = (hits + model.prior_hits) / (visits + model.prior_visits)
            if 0.5 * k >= length - window:
                ends += passes * share
            passes *= 1.0 - share
        out[beam] = np.log((1.0 - model.random_share) * ends + model.random_share * model.random_density)
