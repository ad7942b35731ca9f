# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled wide search: the cost on a lattice of displacements and headings, on the field of nearest walls."""

from __future__ import annotations

import numpy as np

from slam._jit import kernel
from slam.grid._tile_kernels import SHIFT, in_tile, tile_at

CHECKED_BEAMS = 8
"""After this many beams a sum is compared to its bound."""


@kernel
def score_headings(start, stop, grids, particle, predicted, lattice, hits, word_cost, bound, out):
    """Cost [nats] of a scan and of the prior at the headings [start, stop) of a lattice, in the map of one particle.

    lattice: `Lattice`;  hits (K, 2) end points in the robot's frame [m];  word_cost (words,) cost of a beam by the
    field word of the cell that its end point lies in
    out (headings, along, across): the cost where it is at most `bound`, else infinity. All terms of the sum are
    positive, so that it may end at the bound (branch and bound: Olson 2009, Hess et al. 2016).
    """
    table, nearest = grids.field_table[particle], grids.nearest
    width, height = table.shape[1] << SHIFT, table.shape[0] << SHIFT
    beams = hits.shape[0]
    ends = np.empty((beams, 2))
    cos0, sin0 = np.cos(predicted[2]) * grids.per_cell, np.sin(predicted[2]) * grids.per_cell
    for h in range(start, stop):
        theta = predicted[2] + lattice.turn[h]
        cos, sin = np.cos(theta) * grids.per_cell, np.sin(theta) * grids.per_cell
        x0, y0 = predicted[0] * grids.per_cell - grids.corner[0], predicted[1] * grids.per_cell - grids.corner[1]
        for k in range(beams):
            ends[k, 0] = x0 + cos * hits[k, 0] - sin * hits[k, 1]
            ends[k, 1] = y0 + sin * hits[k, 0] + cos * hits[k, 1]
        for a in range(lattice.along.shape[0]):
            for c in range(lattice.across.shape[0]):
                dx = cos0 * lattice.along[a] - sin0 * lattice.across[c]
                dy = sin0 * lattice.along[a] + cos0 * lattice.across[c]
                total = lattice.turn_cost[h] + lattice.along_cost[a] + lattice.across_cost[c]
                k = 0
                while k < beams and total <= bound:
                    for j in range(k, min(k + CHECKED_BEAMS, beams)):
                        u, v = ends[j, 0] + dx, ends[j, 1] + dy
                        word = np.uint64(0)
                        if 0.0 <= u < width and 0.0 <= v < height:
                            cx, cy = int(u), int(v)
                            word = np.uint64(nearest[tile_at(table, cx, cy), in_tile(cx, cy)])
                        total += word_cost[word]
                    k += CHECKED_BEAMS
                out[h, a, c] = total if total <= bound else np.inf
