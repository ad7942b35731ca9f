# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the scan likelihood, the matcher and the improved proposal.

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
from slam.grid._cell_kernels import DIRECTION, mean_x, mean_y
from slam.grid._distance_field_kernels import FAR
from slam.grid._tile_kernels import SHIFT, fine_tile_at, in_fine_tile, in_tile, tile_at

LINES = np.array(
    [(0.0, 0.0)] + [(np.cos((k + 0.5) / 255.0 * np.pi), np.sin((k + 0.5) / 255.0 * np.pi)) for k in range(255)]
)
"""Unit normal of each direction code of a surface word, (256, 2)."""
HALF_LENGTH = 0.75
"""A wall cell stands for a piece of wall this far to both sides of its mean end point [cells]; half a cell's diagonal
would leave gaps in walls that are not parallel to an axis."""


class BeamModel(NamedTuple):
    """The beam end point model."""

    per_sigma2: float
    """1 / s^2 [1/m^2]."""
    per_outlier2: float
    """1 / c^2 [1/m^2]."""
    weight: float
    """w: share of each beam's log-likelihood that counts."""
    far: float
    """Distance charged where no wall is within the field's radius [m]."""


class MotionPrior(NamedTuple):
    """p(x | x', u) about the predicted pose: a mixture of two zero-mean Gaussians in the predicted robot's frame."""

    precision: NDArray[np.float64]
    """1 / variance along, across [1/m^2] and in heading [1/rad^2], (2, 3): odometry good, odometry failed."""
    log_scale: NDArray[np.float64]
    """Log of share times the Gaussian's normalisation, (2,)."""


class Evidence(NamedTuple):
    """What the new pose is judged by, the same for all particles: p(z | m, x) p(x | x', u) but for map and x'."""

    hits: NDArray[np.float64]
    """End points of the scan in the robot's frame [m], (K, 2)."""
    beams: BeamModel
    prior: MotionPrior


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
            if word != FAR:
                cx += offset[word, 0]
                cy += offset[word, 1]
                surface = surfaces[fine_tile_at(surface_table, cx, cy), in_fine_tile(cx, cy)]
                ex, ey = u - cx - mean_x(surface), v - cy - mean_y(surface)
                direction = np.uint64(surface & DIRECTION)
                if direction == 0:
                    length = max(np.sqrt(ex * ex + ey * ey), 1e-9)
                    across, nx, ny = length * cell, ex / length, ey / length
                else:
                    nx, ny = LINES[direction, 0], LINES[direction, 1]
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
def linearise(grids, particle, x, y, theta, hits, model, distances, H, g):
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


@inlined
def wrapped(angle):
    """Angle in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@inlined
def deviation(guess, x, y, theta):
    """Pose (x, y, theta) seen from the guess (3,): along, across [m], heading [rad]."""
    cos, sin = np.cos(guess[2]), np.sin(guess[2])
    dx, dy = x - guess[0], y - guess[1]
    return cos * dx + sin * dy, -sin * dx + cos * dy, wrapped(theta - guess[2])


@inlined
def log_components(precision, log_scale, along, across, turn):
    """Log density of each of the two components of a motion prior, (2, 3) and (2,), at a deviation."""
    a, c, t = along * along, across * across, turn * turn
    return (
        log_scale[0] - 0.5 * (precision[0, 0] * a + precision[0, 1] * c + precision[0, 2] * t),
        log_scale[1] - 0.5 * (precision[1, 0] * a + precision[1, 1] * c + precision[1, 2] * t),
    )


@kernel
def motion_cost(prior, guess, x, y, theta):
    """-log p(x | x', u) [nats]."""
    along, across, turn = deviation(guess, x, y, theta)
    a, b = log_components(prior.precision, prior.log_scale, along, across, turn)
    top = max(a, b)
    return -top - np.log(np.exp(a - top) + np.exp(b - top))


@kernel
def linearise_motion(prior, guess, x, y, theta, H, g):
    """Cost of the motion prior; adds its gradient to g (3,) and its Hessian to H (3, 3).

    The Hessian is that of the Gaussians with their shares at this pose held fixed (one step of expectation
    maximisation), so it is always positive definite.
    """
    along, across, turn = deviation(guess, x, y, theta)
    a, b = log_components(prior.precision, prior.log_scale, along, across, turn)
    top = max(a, b)
    cost = -top - np.log(np.exp(a - top) + np.exp(b - top))
    first, second = np.exp(a + cost), np.exp(b + cost)
    pa = first * prior.precision[0, 0] + second * prior.precision[1, 0]
    pc = first * prior.precision[0, 1] + second * prior.precision[1, 1]
    pt = first * prior.precision[0, 2] + second * prior.precision[1, 2]
    cos, sin = np.cos(guess[2]), np.sin(guess[2])
    H[0, 0] += pa * cos * cos + pc * sin * sin
    H[1, 1] += pa * sin * sin + pc * cos * cos
    H[0, 1] += (pa - pc) * cos * sin
    H[1, 0] += (pa - pc) * cos * sin
    H[2, 2] += pt
    g[0] += pa * along * cos - pc * across * sin
    g[1] += pa * along * sin + pc * across * cos
    g[2] += pt * turn
    return cost


@kernel
def cholesky(A, L):
    """Lower Cholesky factor L of a symmetric 3 x 3 matrix; returns False where A is not positive definite."""
    for i in range(3):
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                L[i, i] = np.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
        for j in range(i + 1, 3):
            L[i, j] = 0.0
    return True


@kernel
def solve(L, x):
    """Solve L L^T y = x; y is written over x (3,)."""
    for i in range(3):
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    for i in range(2, -1, -1):
        for k in range(i + 1, 3):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]


@kernel
def descend(grids, particle, guess, start, evidence, iterations, pose, L):
    """Local minimum of the cost from `start` (3,) by Gauss-Newton with step halving.

    The last step, of less than a millimetre, is taken unseen, and the cost after it is that of the quadratic form.
    pose (3,) out: the optimum;  L (3, 3) out: Cholesky factor of the Hessian before the last step
    Returns the cost and the number of end points near a wall.
    """
    hits, model, prior = evidence
    H, g, step = np.empty((3, 3)), np.empty(3), np.zeros(3)
    distances = np.empty((4, hits.shape[0]))
    x, y, theta = start[0], start[1], start[2]
    best = np.inf
    best_near = 0
    for _ in range(iterations):
        H[:] = 0.0
        g[:] = 0.0
        cost = linearise_motion(prior, guess, x, y, theta, H, g)
        scan, near = linearise(grids, particle, x, y, theta, hits, model, distances, H, g)
        cost += scan
        improved = cost < best - 1e-6
        if improved:
            best, best_near = cost, near
            pose[0], pose[1], pose[2] = x, y, theta
            if not cholesky(H, L):
                break
            step[:] = g
            solve(L, step)
        else:
            step *= 0.5
        if abs(step[0]) < 1e-3 and abs(step[1]) < 1e-3 and abs(step[2]) < 5e-4:
            if improved:
                for a in range(3):
                    pose[a] -= step[a]
                    best -= 0.5 * g[a] * step[a]
            break
        x, y, theta = pose[0] - step[0], pose[1] - step[1], pose[2] - step[2]
    return best, best_near
