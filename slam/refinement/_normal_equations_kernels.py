# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled normal equations of all poses, surfels eliminated.

A surfel e is a line with a free offset o_e along its normal n_e and a free slope a_e. With the weights w_i of its end
points p_i, their distances s_i from the middle of its line and a weak prior on the slope, the cost
1/2 sum_i w_i (n_e . p_i - o_e - a_e s_i)^2 has its minimum at the weighted regression line, so both can be eliminated
from the equations (variable projection; Golub, Pereyra 1973; in bundle adjustment the Schur complement):

    H = D - B W^-1 B^T,    D block diagonal, a block a scan,    B two 3-vectors for each scan that sees a surfel

Since distances are from the middle, W is diagonal: offsets and slopes are unknowns like each other, first all offsets,
then all slopes. H is never formed; conjugate gradients need its product with a vector.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import kernel


class SurfelObservations(NamedTuple):
    """How each scan observes offsets and slopes of surfels: the 3-vectors B, those of scan i from first[i] on."""

    first: NDArray[np.int64]
    """(scans + 1,)."""
    surfel: NDArray[np.int32]
    """Number of the unknown, (observations,): that of the surfel for its offset, plus their number for its slope."""
    weight: NDArray[np.float64]
    """Sum of the weights of the end points [1/m^2], for a slope times their distances s [1/m], (observations,)."""
    heading_jacobian: NDArray[np.float64]
    """The same sum times the derivatives of n . p by the heading, (observations,)."""
    residual: NDArray[np.float64]
    """Sum of the weights times the distances from the line [1/m], (observations,); 0 for a slope,
    since it counts once."""


@kernel
def count_surfels(start, stop, first, surfel, surfels, count):
    """How many of all `surfels` each of the scans [start, stop) sees, count (scans,) out; surfel (n,): -1 = none."""
    last = np.full(surfels, -1, np.int64)  # scan that saw each
    for scan in range(start, stop):
        count[scan] = 0
        for i in range(first[scan], first[scan + 1]):
            e = surfel[i]
            if e >= 0 and last[e] != scan:
                last[e] = scan
                count[scan] += 1


@kernel
def collect(start, stop, first, poses, points, matches, normal, diagonal, gradient, observations):
    """Equations of the scans [start, stop): diagonal (scans, 3, 3) and gradient (scans, 3) are added to.

    first (scans + 1,): the end points of scan i, points (n, 2), are those from first[i] to first[i + 1]
    observations out: of the offset and of the slope of each surfel that a scan sees, `first` given
    """
    row_of = np.full(normal.shape[0], -1, np.int64)
    for scan in range(start, stop):
        H, g, begin = diagonal[scan], gradient[scan], observations.first[scan]
        end = begin
        for i in range(first[scan], first[scan + 1]):
            e = matches.surfel[i]
            if e < 0:
                continue
            w, nx, ny = matches.weight[i], normal[e, 0], normal[e, 1]
            nt = ny * (points[i, 0] - poses[scan, 0]) - nx * (points[i, 1] - poses[scan, 1])
            r, s = w * matches.across[i], matches.along[i]
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
                end += 2
                observations.surfel[row], observations.surfel[row + 1] = e, normal.shape[0] + e
                for own in range(row, end):
                    observations.weight[own], observations.heading_jacobian[own] = 0.0, 0.0
                    observations.residual[own] = 0.0
            observations.weight[row] += w
            observations.heading_jacobian[row] += w * nt
            observations.residual[row] += r
            observations.weight[row + 1] += w * s
            observations.heading_jacobian[row + 1] += w * s * nt
        H[1, 0], H[2, 0], H[2, 1] = H[0, 1], H[0, 2], H[1, 2]


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
