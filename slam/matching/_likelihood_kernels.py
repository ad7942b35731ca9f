# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the scan likelihood p(z | m, x): the beam end point model on the field of nearest walls.

The negative logarithm of p(z | m, x) p(x | x', u) is called the cost [nats]:

    cost(x) = w/2 sum_k rho(d_k^2 / s^2)  -  log sum_j pi_j N(delta(x); 0, Sigma_j),    rho(e) = e / (1 + e s^2 / c^2)

d_k is the distance of beam k's end point to the nearest wall (beam end point model: Thrun, Burgard, Fox 2005, section
6.4), rho the bounded loss of Geman and McClure (1985) in the place of the mixture with random readings, delta the
deviation from the odometry seen from the pose that it predicts.
"""

from __future__ import annotations

import numpy as np

from slam._jit import kernel
from slam.grid._cell_kernels import DIRECTION, NO_WALL, mean_x, mean_y
from slam.grid._tile_kernels import SHIFT, fine_tile_at, in_fine_tile, in_tile, tile_at

NORMALS = np.array(
    [(0.0, 0.0)] + [(np.cos((k + 0.5) / 255.0 * np.pi), np.sin((k + 0.5) / 255.0 * np.pi)) for k in range(255)]
)
"""Unit normal of each direction code of a surface word, (256, 2)."""
HALF_LENGTH = 0.75
"""A wall cell stands for a piece of wall this far to both sides of its mean end point [cells]; half a cell's diagonal
would leave gaps in walls that are not parallel to an axis."""


@kernel
def wall_distances(grids, particle, x, y, theta, hits, far, out):
    """Distance vectors from the nearest pieces of wall to the end points of a scan taken at the pose (x, y, theta).

    hits (K, 2) end points in the robot's frame [m];  far [m] is charged where no wall is within the field's radius
    out (4, K): distance across the wall [m] in the direction of its unit normal, distance along the wall beyond the
    end of the piece [m], the normal's two components. Where walls form no line the normal points at the end point;
    where there is no wall at all it is zero, so that such a beam pulls nowhere.
    """
    surface_table, field_table = grids.surface_table[particle], grids.field_table[particle]
    surfaces, nearest, offset, cell = grids.surface, grids.nearest, grids.offset, grids.cell
    width, height = float(field_table.shape[1] << SHIFT), float(field_table.shape[0] << SHIFT)
    cos, sin = np.cos(theta) * grids.per_cell, np.sin(theta) * grids.per_cell
    x0, y0 = x * grids.per_cell - grids.corner[0], y * grids.per_cell - grids.corner[1]
    for k in range(hits.shape[0]):
        u = x0 + cos * hits[k, 0] - sin * hits[k, 1]
        v = y0 + sin * hits[k, 0] + cos * hits[k, 1]
        across, along, nx, ny = far, 0.0, 0.0, 0.0
        if 0.0 <= u < width and 0.0 <= v < height:
            cx, cy = int(u), int(v)
            word = np.uint64(nearest[tile_at(field_table, cx, cy), in_tile(cx, cy)])
            if word != NO_WALL:
                cx += offset[word, 0]
                cy += offset[word, 1]
                surface = surfaces[fine_tile_at(surface_table, cx, cy), in_fine_tile(cx, cy)]
                ex, ey = u - cx - mean_x(surface), v - cy - mean_y(surface)
                direction = np.uint64(surface & DIRECTION)
                if direction == 0:
                    length = max(np.sqrt(ex * ex + ey * ey), 1e-9)
                    across, nx, ny = length * cell, ex / length, ey / length
                else:
                    nx, ny = NORMALS[direction, 0], NORMALS[direction, 1]
                    across = (nx * ex + ny * ey) * cell
                    along = nx * ey - ny * ex
                    along = (along - min(max(along, -HALF_LENGTH), HALF_LENGTH)) * cell
        out[0, k], out[1, k], out[2, k], out[3, k] = across, along, nx, ny


@kernel
def scan_cost(grids, particle, x, y, theta, hits, model, distances):
    """-log p(z | m, x) up to a constant [nats]; hits (K, 2) end points in the robot's frame [m]; distances (4, K)
    is overwritten."""
    wall_distances(grids, particle, x, y, theta, hits, model.far, distances)
    total = 0.0
    for k in range(hits.shape[0]):
        d2 = distances[0, k] * distances[0, k] + distances[1, k] * distances[1, k]
        total += d2 / (1.0 + d2 * model.per_outlier2)
    return 0.5 * model.weight * model.per_sigma2 * total


@kernel
def linearise_scan(grids, particle, x, y, theta, hits, model, distances, H, g):
    """Cost of a scan, its gradient g (3,) and Gauss-Newton Hessian H (3, 3) at a pose, both added to what is there.

    Also returns the number of end points within the outlier distance of a wall. distances (4, K) is overwritten.
    """
    wall_distances(grids, particle, x, y, theta, hits, model.far, distances)
    cos, sin = np.cos(theta), np.sin(theta)
    scale = model.weight * model.per_sigma2
    total = 0.0
    near = 0
    hxx, hxy, hyy, hxt, hyt, htt, gx, gy, gt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(hits.shape[0]):
        across, along, nx, ny = distances[0, k], distances[1, k], distances[2, k], distances[3, k]
        d2 = across * across + along * along
        bound = 1.0 / (1.0 + d2 * model.per_outlier2)
        total += d2 * bound
        near += 1 if d2 * model.per_outlier2 <= 1.0 else 0
        w = bound * bound  # d rho / d e: the weight of iteratively reweighted least squares
        rx = cos * hits[k, 0] - sin * hits[k, 1]
        ry = sin * hits[k, 0] + cos * hits[k, 1]
        nt = ny * rx - nx * ry  # derivative of n . p by the heading
        hxx += w * nx * nx
        hxy += w * nx * ny
        hyy += w * ny * ny
        hxt += w * nx * nt
        hyt += w * ny * nt
        htt += w * nt * nt
        gx += w * across * nx
        gy += w * across * ny
        gt += w * across * nt
        if along != 0.0:
            tt = nx * rx + ny * ry  # the same for the direction along the wall, (-ny, nx)
            hxx += w * ny * ny
            hxy -= w * nx * ny
            hyy += w * nx * nx
            hxt -= w * ny * tt
            hyt += w * nx * tt
            htt += w * tt * tt
            gx -= w * along * ny
            gy += w * along * nx
            gt += w * along * tt
    H[0, 0] += scale * hxx
    H[0, 1] += scale * hxy
    H[1, 1] += scale * hyy
    H[0, 2] += scale * hxt
    H[1, 2] += scale * hyt
    H[2, 2] += scale * htt
    H[1, 0], H[2, 0], H[2, 1] = H[0, 1], H[0, 2], H[1, 2]
    g[0] += scale * gx
    g[1] += scale * gy
    g[2] += scale * gt
    return 0.5 * scale * total, near


@kernel
def score_poses(start, stop, grids, poses, hits, model, out):
    """Log-likelihood out (poses,) [nats, up to a constant] of a scan at poses [start, stop) of (poses, 3).

    All poses use the map of particle 0.  hits (K, 2) end points in the robot's frame [m];  model: `BeamModel`
    """
    distances = np.empty((4, hits.shape[0]))
    for i in range(start, stop):
        out[i] = -scan_cost(grids, 0, poses[i, 0], poses[i, 1], poses[i, 2], hits, model, distances)
