# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled normal equations: end points matched to surfels, and the equations of all poses, surfels eliminated.

A surfel e is a line with a fixed normal n_e and a free offset o_e along it. With the weights w_i of its end points p_i
the cost 1/2 sum_i w_i (n_e . p_i - o_e)^2 has its minimum at the weighted mean, so the offsets can be eliminated from
the equations (variable projection; Golub, Pereyra 1973; in bundle adjustment the Schur complement):

    H = D - B W^-1 B^T,    D block diagonal, a block a scan,    B a 3-vector for each scan that sees a surfel

H is never formed; conjugate gradients need its product with a vector.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import kernel

MIN_COSINE = 0.05
"""A surfel can have been seen where the cosine of the angle of incidence is at least this."""
MIN_PARALLEL_COSINE = 0.9
"""An end point belongs to a surfel where the cosine between it and the line through the neighbouring end points is at
least this: what stands before a wall or around a corner does not."""
GATE_SIGMAS = 3.0
"""End points belong to a surfel up to the gate plus this many standard deviations of the noise: 99.7 % of them."""
CENTRE_PREFERENCE = 1e-4
"""Breaks ties between surfels: at equal distance the nearest centre wins; too small to decide otherwise."""


class Matches(NamedTuple):
    """Which surfel each end point belongs to."""

    surfel: NDArray[np.int32]
    """Its number, (n,); -1 = none."""
    across: NDArray[np.float64]
    """Distance of the end point along the normal [m], (n,): from its surfel, after `weigh_points` from the
    weighted mean of its surfel's end points."""
    variance: NDArray[np.float64]
    """Variance of that distance [m^2], (n,)."""
    weight: NDArray[np.float64]
    """Weight in the equations [1/m^2], (n,); 0 where there is no surfel."""


class SurfelObservations(NamedTuple):
    """How each scan observes each surfel: the 3-vectors B, those of scan i from first[i] to first[i + 1]."""

    first: NDArray[np.int64]
    """(scans + 1,)."""
    surfel: NDArray[np.int32]
    """Number of the surfel, (observations,)."""
    weight: NDArray[np.float64]
    """Sum of the weights of the end points [1/m^2], (observations,)."""
    heading_jacobian: NDArray[np.float64]
    """Sum of the weights times the derivatives of n . p by the heading [1/m], (observations,)."""
    residual: NDArray[np.float64]
    """Sum of the weights times the distances from the surfel [1/m], (observations,)."""


@kernel
def match_points(start, stop, placed, ranges, cell_of, surfels, noise, spacing, gate, matches):
    """Find the surfel of each end point in [start, stop).

    The nearest of those that face where the point was seen from and are parallel to the line through the end points
    about it, on a piece of wall `spacing` [m] long to both sides, no farther across than `gate` [m] plus three standard
    deviations of the noise, as far as the surfel is listed for the point's cell.
    """
    points, view_directions = placed.points, placed.view_directions
    point, normal, _, lines, first, items = surfels
    for i in range(start, stop):
        matches.surfel[i] = -1
        matches.weight[i] = 0.0
        nearest = np.inf
        cell = cell_of[i]
        ahead = (
            lines.normal[cell, 0, 0] * view_directions[i, 0] + lines.normal[cell, 0, 1] * view_directions[i, 1] >= 0.0
        )
        side = 0 if lines.weight[cell, 0] > 0.0 and ahead else 1
        if not lines.weight[cell, side] > 0.0:
            continue
        ax, ay = lines.normal[cell, side]
        r2 = ranges[i] * ranges[i]
        for k in range(first[cell_of[i]], first[cell_of[i] + 1]):
            e = items[k]
            nx, ny = normal[e, 0], normal[e, 1]
            cosine = nx * view_directions[i, 0] + ny * view_directions[i, 1]
            if cosine < MIN_COSINE or ax * nx + ay * ny < MIN_PARALLEL_COSINE:
                continue
            dx, dy = points[i, 0] - point[e, 0], points[i, 1] - point[e, 1]
            across, along = nx * dx + ny * dy, abs(nx * dy - ny * dx)
            c2 = cosine * cosine
            variance = noise.floor + r2 * (noise.along * c2 + noise.across * (1.0 - c2))
            if along > spacing or abs(across) > gate + GATE_SIGMAS * np.sqrt(variance + noise.shared):
                continue
            beyond = max(along - 0.5 * spacing, 0.0)
            distance = across * across + beyond * beyond + CENTRE_PREFERENCE * along * along
            if distance < nearest:
                nearest = distance
                matches.surfel[i], matches.across[i], matches.variance[i] = e, across, variance


@kernel
def weigh_points(matches, first, each, gate, shared, total):
    """Weights of all end points, and their distances from the weighted means of their surfels.

    Bounded loss of Geman and McClure (1985) with the scale of `match_points`' gate, by two rounds of reweighting. Then
    the end points of scan i, from first[i] to first[i + 1], that are on one surfel share an error of variance `shared`
    [m^2]: their mean counts as much as it would with that error, and each as much less.
    each: how many hits an end point stands for;  total (surfels,) out: sums of the weights
    """
    surfel, across, variance, weight = matches
    mean = np.empty(total.shape[0])
    for _ in range(2):
        total[:] = 0.0
        mean[:] = 0.0
        for i in range(surfel.shape[0]):
            e = surfel[i]
            if e >= 0:
                bound = gate + GATE_SIGMAS * np.sqrt(variance[i] + shared)
                rho = 1.0 / (1.0 + across[i] * across[i] / (bound * bound))
                weight[i] = each * rho * rho / variance[i]
                total[e] += weight[i]
                mean[e] += weight[i] * across[i]
        subtract_means(surfel, mean, total, across)
    share_errors(first, surfel, shared, weight, total)
    mean[:] = 0.0
    for i in range(surfel.shape[0]):
        if surfel[i] >= 0:
            mean[surfel[i]] += weight[i] * across[i]
    subtract_means(surfel, mean, total, across)


@kernel
def subtract_means(surfel, sums, total, across):
    """Subtract from the distances across (n,) the means of their surfels, sums / total (surfels,)."""
    for i in range(surfel.shape[0]):
        if surfel[i] >= 0:
            across[i] -= sums[surfel[i]] / total[surfel[i]]


@kernel
def share_errors(first, surfel, shared, weight, total):
    """Reduce the weights w of the end points of a scan on a surfel by 1 / (1 + shared sum w): their mean then has the
    variance shared + 1 / sum w. total (surfels,) out: sums of the weights."""
    of_scan = np.zeros(total.shape[0])
    total[:] = 0.0
    for scan in range(first.shape[0] - 1):
        for i in range(first[scan], first[scan + 1]):
            if surfel[i] >= 0:
                of_scan[surfel[i]] = 0.0
        for i in range(first[scan], first[scan + 1]):
            if surfel[i] >= 0:
                of_scan[surfel[i]] += weight[i]
        for i in range(first[scan], first[scan + 1]):
            e = surfel[i]
            if e >= 0:
                weight[i] /= 1.0 + shared * of_scan[e]
                total[e] += weight[i]


@kernel
def collect(start, stop, poses, points, matches, normal, diagonal, gradient, observations, count):
    """Equations of the scans [start, stop): diagonal (scans, 3, 3) and gradient (scans, 3) are added to.

    observations out: arrays as long as the cloud, those of scan i from first[i] on, where its end points begin too
    count (scans,) out: how many these are
    """
    first = observations.first
    row_of = np.full(normal.shape[0], -1, np.int64)
    for scan in range(start, stop):
        H, g, begin = diagonal[scan], gradient[scan], first[scan]
        end = begin
        for i in range(begin, first[scan + 1]):
            e = matches.surfel[i]
            if e < 0:
                continue
            w, nx, ny = matches.weight[i], normal[e, 0], normal[e, 1]
            nt = ny * (points[i, 0] - poses[scan, 0]) - nx * (points[i, 1] - poses[scan, 1])
            r = w * matches.across[i]
            H[0, 0] += w * nx * nx
            H[0, 1] += w * nx * ny
            H[1, 1] += w * ny * ny
            H[0, 2] += w * nx * nt
            H[1, 2] += w * ny * nt
            H[2, 2] += w * nt * nt
            g[0] += r * nx
            g[1] += r * ny
            g[2] += r * nt
            row = row_of[e]
            if row < begin:  # of an earlier scan, or none
                row_of[e] = row = end
                observations.surfel[row], observations.residual[row] = e, 0.0
                observations.weight[row], observations.heading_jacobian[row] = 0.0, 0.0
                end += 1
            observations.weight[row] += w
            observations.heading_jacobian[row] += w * nt
            observations.residual[row] += r
        H[1, 0], H[2, 0], H[2, 1] = H[0, 1], H[0, 2], H[1, 2]
        count[scan] = end - begin


@kernel
def subtract_schur_complement(observations, normal, total, x, out):
    """Subtract B W^-1 B^T x from out (scans, 3): the surfels follow the poses; x (scans, 3), total (surfels,) = W."""
    first, surfel, weight, heading_jacobian, _ = observations
    follows = np.zeros(total.shape[0])
    for scan in range(x.shape[0]):
        for k in range(first[scan], first[scan + 1]):
            e = surfel[k]
            follows[e] += (
                weight[k] * (normal[e, 0] * x[scan, 0] + normal[e, 1] * x[scan, 1]) + heading_jacobian[k] * x[scan, 2]
            )
    for e in range(total.shape[0]):
        follows[e] = follows[e] / total[e] if total[e] > 0.0 else 0.0
    for scan in range(x.shape[0]):
        a, b, c = 0.0, 0.0, 0.0
        for k in range(first[scan], first[scan + 1]):
            e = surfel[k]
            a += weight[k] * normal[e, 0] * follows[e]
            b += weight[k] * normal[e, 1] * follows[e]
            c += heading_jacobian[k] * follows[e]
        out[scan, 0] -= a
        out[scan, 1] -= b
        out[scan, 2] -= c


@kernel
def dot(a, b):
    """Sum of the products of two arrays (n, 3), in order: BLAS adds up in parts whose number depends on its threads."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i, 0] * b[i, 0] + a[i, 1] * b[i, 1] + a[i, 2] * b[i, 2]
    return total
