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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import inlined, kernel
from slam.grid._cell_kernels import DIRECTION, NO_STEP, mean_x, mean_y, step_x, step_y
from slam.grid._tile_kernels import FINE_MASK, FINE_SHIFT, MASK, SHIFT

NORMALS = np.array(
    [(0.0, 0.0)] + [(np.cos((k + 0.5) / 255.0 * np.pi), np.sin((k + 0.5) / 255.0 * np.pi)) for k in range(255)]
)
"""Unit normal of each direction code of a surface word, (256, 2)."""
HALF_LENGTH = 0.75
"""A wall cell stands for a piece of wall this far to both sides of its mean end point [cells]; half a cell's diagonal
would leave gaps in walls that are not parallel to an axis."""


class Walls(NamedTuple):
    """The walls in the map of one particle, as the look-up of end points reads them."""

    field_table: NDArray[np.int32]
    """Tiles of `nearest`, row by row, (rows * columns,)."""
    nearest: NDArray[np.uint8] | NDArray[np.uint16]
    """Field words, (tiles, SIDE * SIDE)."""
    step: NDArray[np.int32]
    """Way from a cell to its nearest wall for each field word, see `_cell_kernels`, (words,)."""
    surface_table: NDArray[np.int32]
    """Fine tiles of `surface`, row by row."""
    surface: NDArray[np.uint32]
    """Surface words, (tiles, FINE_SIDE * FINE_SIDE)."""
    columns: int
    """Columns of the field's table."""
    fine_columns: int
    """Columns of the surface's table."""
    corner: tuple[float, float]
    """Corner of the tables in x and y [cells]."""
    size: tuple[float, float]
    """Width and height of the tables [cells]."""
    per_cell: float
    """1 / side of a cell [1/m]."""
    cell: float
    """Side of a cell [m]."""


class EndPoints(NamedTuple):
    """The end points of a scan on their way to the nearest walls, an array (K,) for each quantity.

    Made once for all particles of a call: making its arrays takes as long as looking up 200 end points.

    Arrays, not one loop: loops that only calculate are compiled to vector instructions (four end points at once),
    loops that only look up have no branches to be guessed wrong. One loop for all took 2.6 times as long.
    """

    x: NDArray[np.float64]
    """End point in the robot's frame [m]."""
    y: NDArray[np.float64]
    u: NDArray[np.float64]
    """End point in cells from the tables' corner, then from the corner of the nearest wall's cell."""
    v: NDArray[np.float64]
    tile: NDArray[np.int32]
    """Place of its tile in the table; then that of the wall's fine tile."""
    inside: NDArray[np.int32]
    """Index of its cell in the tile; then that of the wall's cell in the fine tile."""
    step: NDArray[np.int32]
    """Way to the nearest wall, `NO_STEP` where there is none."""
    surface: NDArray[np.uint32]
    """Surface word of that wall."""
    across: NDArray[np.float64]
    """What `distance_vector` returns."""
    along: NDArray[np.float64]
    nx: NDArray[np.float64]
    ny: NDArray[np.float64]
    term: NDArray[np.float64]
    """Its share in the cost, without the factor of all."""
    weight: NDArray[np.float64]
    """d rho / d e: the weight of iteratively reweighted least squares."""
    turn: NDArray[np.float64]
    """Derivative of the distance across the wall by the heading [m/rad]."""


@inlined
def walls_of(grids, particle):
    """The walls in the map of one particle."""
    rows, columns = grids.field_table.shape[1], grids.field_table.shape[2]
    return Walls(
        grids.field_table[particle].ravel(),
        grids.nearest,
        grids.step,
        grids.surface_table[particle].ravel(),
        grids.surface,
        columns,
        grids.surface_table.shape[2],
        (float(grids.corner[0]), float(grids.corner[1])),
        (float(columns << SHIFT), float(rows << SHIFT)),
        grids.per_cell,
        grids.cell,
    )


@inlined
def end_points(hits):
    """Room for the end points of a scan, hits (K, 2) in the robot's frame [m]."""
    n = hits.shape[0]
    x, y, u, v = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    tile, inside, step, surface = (
        np.empty(n, np.int32),
        np.empty(n, np.int32),
        np.empty(n, np.int32),
        np.empty(n, np.uint32),
    )
    across, along, nx, ny = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        x[k], y[k] = hits[k, 0], hits[k, 1]
    return EndPoints(
        x, y, u, v, tile, inside, step, surface, across, along, nx, ny, np.empty(n), np.empty(n), np.empty(n)
    )


@inlined
def find_walls(walls, points, x, y, theta):
    """Find the wall nearest to each end point of a scan taken at the pose (x, y, theta): step, surface, u and v."""
    field_table, nearest, steps = walls.field_table, walls.nearest, walls.step
    surface_table, surfaces = walls.surface_table, walls.surface
    us, vs, tile, inside, step, surface = points.u, points.v, points.tile, points.inside, points.step, points.surface
    xs, ys, columns, fine_columns = points.x, points.y, walls.columns, walls.fine_columns
    width, height = walls.size
    n = xs.shape[0]
    cos, sin = np.cos(theta) * walls.per_cell, np.sin(theta) * walls.per_cell
    x0, y0 = x * walls.per_cell - walls.corner[0], y * walls.per_cell - walls.corner[1]
    for k in range(n):
        u = x0 + cos * xs[k] - sin * ys[k]
        v = y0 + sin * xs[k] + cos * ys[k]
        within = (u >= 0.0) & (u < width) & (v >= 0.0) & (v < height)
        cx, cy = np.int32(u if within else 0.0), np.int32(v if within else 0.0)
        us[k], vs[k] = u if within else -1.0, v
        tile[k] = (cy >> SHIFT) * columns + (cx >> SHIFT)
        inside[k] = ((cy & MASK) << SHIFT) | (cx & MASK)
    for k in range(n):
        step[k] = steps[np.uint64(nearest[np.uint64(field_table[np.uint64(tile[k])]), np.uint64(inside[k])])]
    for k in range(n):
        known = (step[k] != NO_STEP) & (us[k] >= 0.0)
        cx = np.int32(us[k]) + step_x(step[k]) if known else 0
        cy = np.int32(vs[k]) + step_y(step[k]) if known else 0
        us[k] -= cx
        vs[k] -= cy
        tile[k] = (cy >> FINE_SHIFT) * fine_columns + (cx >> FINE_SHIFT)
        inside[k] = ((cy & FINE_MASK) << FINE_SHIFT) | (cx & FINE_MASK)
        step[k] = step[k] if known else NO_STEP
    for k in range(n):
        surface[k] = surfaces[np.uint64(surface_table[np.uint64(tile[k])]), np.uint64(inside[k])]


@inlined
def distance_vector(u, v, step, surface, cell, far):
    """Distance vector from a piece of wall to an end point, as it was found.

    Returns the distance across the wall [m] in the direction of its unit normal, the distance along the wall beyond
    the end of the piece [m], the normal's two components. Where walls form no line the normal points at the end point;
    where there is no wall at all it is zero, so that such a beam pulls nowhere.
    """
    ex, ey = u - mean_x(surface), v - mean_y(surface)
    direction = np.uint64(surface & DIRECTION)
    known, line = step != NO_STEP, direction != 0
    length = max(np.sqrt(ex * ex + ey * ey), 1e-9)
    nx = NORMALS[direction, 0] if line else ex / length
    ny = NORMALS[direction, 1] if line else ey / length
    across = nx * ex + ny * ey if line else length
    along = nx * ey - ny * ex
    along = (along - min(max(along, -HALF_LENGTH), HALF_LENGTH)) * cell if line else 0.0
    return across * cell if known else far, along if known else 0.0, nx if known else 0.0, ny if known else 0.0


@inlined
def measure_distances(walls, points, x, y, theta, far):
    """Distance vectors of the end points of a scan taken at the pose (x, y, theta): across, along, nx and ny."""
    find_walls(walls, points, x, y, theta)
    us, vs, step, surface, cell = points.u, points.v, points.step, points.surface, walls.cell
    across, along, nx, ny = points.across, points.along, points.nx, points.ny
    for k in range(us.shape[0]):
        across[k], along[k], nx[k], ny[k] = distance_vector(us[k], vs[k], step[k], surface[k], cell, far)


@kernel
def wall_distances(grids, particle, x, y, theta, hits, far, out):
    """Distance vectors from the nearest pieces of wall to the end points of a scan taken at the pose (x, y, theta).

    hits (K, 2) end points in the robot's frame [m];  far [m] is charged where no wall is within the field's radius
    out (4, K): what `distance_vector` returns
    """
    points = end_points(hits)
    measure_distances(walls_of(grids, particle), points, x, y, theta, far)
    for k in range(hits.shape[0]):
        out[0, k], out[1, k], out[2, k], out[3, k] = points.across[k], points.along[k], points.nx[k], points.ny[k]


@kernel
def scan_costs(walls, poses, points, model, out):
    """-log p(z | m, x) up to a constant [nats] at each of the poses (n, 3): out (n,); points: `EndPoints`."""
    us, vs, steps, surfaces, terms, cell = points.u, points.v, points.step, points.surface, points.term, walls.cell
    far, per_outlier2 = model.far, model.per_outlier2
    for j in range(poses.shape[0]):
        find_walls(walls, points, poses[j, 0], poses[j, 1], poses[j, 2])
        for k in range(us.shape[0]):
            across, along, _, _ = distance_vector(us[k], vs[k], steps[k], surfaces[k], cell, far)
            d2 = across * across + along * along
            terms[k] = d2 / (1.0 + d2 * per_outlier2)
        total = 0.0
        for k in range(us.shape[0]):
            total += terms[k]
        out[j] = 0.5 * model.weight * model.per_sigma2 * total


@inlined
def weigh_beams(points, cos, sin, per_outlier2):
    """Terms, weights and turns of all end points from their distances; returns how many of them are near a wall."""
    xs, ys, weight, turn, term = points.x, points.y, points.weight, points.turn, points.term
    across, along, nx, ny = points.across, points.along, points.nx, points.ny
    near = 0
    for k in range(xs.shape[0]):
        d2 = across[k] * across[k] + along[k] * along[k]
        bound = 1.0 / (1.0 + d2 * per_outlier2)
        term[k] = d2 * bound
        near += 1 if d2 * per_outlier2 <= 1.0 else 0
        weight[k] = bound * bound
        rx = cos * xs[k] - sin * ys[k]
        ry = sin * xs[k] + cos * ys[k]
        turn[k] = ny[k] * rx - nx[k] * ry
    return near


@inlined
def linearise_scan(walls, points, x, y, theta, model, H, g):
    """Cost of a scan, its gradient g (3,) and Gauss-Newton Hessian H (3, 3) at a pose, both added to what is there.

    Also returns the number of end points within the outlier distance of a wall.
    """
    measure_distances(walls, points, x, y, theta, model.far)
    acrosses, alongs, nxs, nys = points.across, points.along, points.nx, points.ny
    xs, ys, weights, turns, terms = points.x, points.y, points.weight, points.turn, points.term
    cos, sin, scale = np.cos(theta), np.sin(theta), model.weight * model.per_sigma2
    near = weigh_beams(points, cos, sin, model.per_outlier2)
    total = 0.0
    hxx, hxy, hyy, hxt, hyt, htt, gx, gy, gt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(xs.shape[0]):
        across, along, nx, ny, w, nt = acrosses[k], alongs[k], nxs[k], nys[k], weights[k], turns[k]
        total += terms[k]
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
            rx = cos * xs[k] - sin * ys[k]
            ry = sin * xs[k] + cos * ys[k]
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
    scan_costs(walls_of(grids, 0), poses[start:stop], end_points(hits), model, out[start:stop])
    for i in range(start, stop):
        out[i] = -out[i]
