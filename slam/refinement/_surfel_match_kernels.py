# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled matches of end points to surfels, their weights, and the lines through the end points of each surfel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import kernel
from slam.refinement._cell_index_kernels import cell_at

MIN_COSINE = 0.05
"""A surfel can have been seen where the cosine of the angle of incidence is at least this."""
MIN_PARALLEL_COSINE = 0.9
"""An end point belongs to a surfel where the cosine between it and the line through the neighbouring end points is at
least this: what stands before a wall or around a corner does not."""
CORNER_SIGMAS = 2.0
"""No end point within this many standard deviations of its noise from a corner belongs to a surfel. There the noise
puts end points of one wall into the plane of the other, and from one side only: jambs of doors, seen from afar, seem
farther than they are."""
GATE_SIGMAS = 3.0
"""End points belong to a surfel up to the gate plus this many standard deviations of the noise: 99.7 % of them."""
SLOPE_PRECISION = 0.1**-2
"""Precision with which a surfel has the normal that it was found with [1/rad^2]."""


class Matches(NamedTuple):
    """Which surfel each end point belongs to."""

    surfel: NDArray[np.int32]
    """Its number, (n,); -1 = none."""
    across: NDArray[np.float64]
    """Distance of the end point along the normal [m], (n,): from the surfel, after `weigh_points` from the line through
    its end points."""
    along: NDArray[np.float64]
    """Distance along the wall [m], to the left of the normal, (n,): from the surfel's point, after `weigh_points` from
    the middle of its line."""
    variance: NDArray[np.float64]
    """Variance of the distance across [m^2], (n,)."""
    weight: NDArray[np.float64]
    """Weight in the equations [1/m^2], (n,); 0 where there is no surfel."""


@kernel
def match_points(start, stop, placed, ranges, cells, cell_of, surfels, noise, found, spacing, gate, matches):
    """Find the surfel of each end point in [start, stop).

    Of those that face where the point was seen from and are parallel to the line through the end points about it, on a
    piece of wall `spacing` [m] long to both sides, no farther across than `gate` [m] plus three standard deviations of
    the noise, as far as the surfel is listed for the point's cell, it is the one with the nearest centre: were it the
    one whose line is nearest, lines that are aslant would draw the points that make them so. Near a corner there is
    none. The variance follows the range at which the beam meets the line, not the one that was read: readings that are
    too short would count more than those that are too long, and walls seem the nearer the farther they are.
    noise: with which end points count;  found: as it was estimated
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
        for k in range(first[cell_of[i]], first[cell_of[i] + 1]):
            e = items[k]
            nx, ny = normal[e, 0], normal[e, 1]
            cosine = nx * view_directions[i, 0] + ny * view_directions[i, 1]
            if cosine < MIN_COSINE or ax * nx + ay * ny < MIN_PARALLEL_COSINE:
                continue
            dx, dy = points[i, 0] - point[e, 0], points[i, 1] - point[e, 1]
            across, along = nx * dx + ny * dy, nx * dy - ny * dx
            away = across + ranges[i] * cosine  # of the surfel's line from the lidar
            variance = noise.floor + away * away * (noise.along + noise.across * (1.0 / (cosine * cosine) - 1.0))
            if abs(along) > spacing or abs(across) > gate + GATE_SIGMAS * np.sqrt(variance + noise.shared):
                continue
            distance = across * across + along * along
            if distance < nearest:
                nearest = distance
                matches.surfel[i], matches.variance[i] = e, variance
                matches.across[i], matches.along[i] = across, along
        if matches.surfel[i] >= 0:
            variance = found.floor + found.shared + found.along * ranges[i] * ranges[i]
            margin = min(CORNER_SIGMAS * np.sqrt(variance), spacing)
            if is_near_corner(points[i], matches.across[i], margin, normal[matches.surfel[i]], cells, lines):
                matches.surfel[i] = -1


@kernel
def is_near_corner(place, across, margin, normal, cells, lines):
    """Whether a line at an angle to the wall lies on it within `margin` [m] to either side of a place (2,), which is
    `across` [m] from the wall with a normal (2,)."""
    nx, ny = normal[0], normal[1]
    steps = int(np.ceil(margin / cells.side))
    for k in range(-steps, steps + 1):
        x, y = place[0] - across * nx, place[1] - across * ny
        step = max(min(k * cells.side, margin), -margin)
        column = int(np.floor((x - step * ny - cells.corner[0]) / cells.side))
        row = int(np.floor((y + step * nx - cells.corner[1]) / cells.side))
        cell = cell_at(cells.tiles, cells.indices, column, row)
        if cell < 0:
            continue
        for side in range(2):
            mx, my = lines.normal[cell, side]
            if lines.weight[cell, side] > 0.0 and abs(mx * nx + my * ny) < MIN_PARALLEL_COSINE:
                return True
    return False


@kernel
def weigh_points(matches, first, each, gate, shared, surplus, normal, total):
    """Weights of all end points; lines through those of each surfel, and where the end points lie about them.

    Bounded loss of Geman and McClure (1985) with the scale of `match_points`' gate, by two rounds of reweighting. Then
    the end points of scan i, from first[i] to first[i + 1], that are on one surfel share an error of variance `shared`
    [m^2], or more where the surfel is no straight line: their mean counts as much as it would with that error, and each
    as much less.
    each: how many hits an end point stands for;  surplus [m^2]: by how much variances are larger than those estimated
    normal (surfels, 2): turned to those of the lines
    total (2 surfels,) out: precisions of the offsets, the sums of the weights [1/m^2], then of the slopes [1/rad^2]
    """
    surfel, across, variance, weight = matches.surfel, matches.across, matches.variance, matches.weight
    for _ in range(2):
        for i in range(surfel.shape[0]):
            if surfel[i] >= 0:
                bound = gate + GATE_SIGMAS * np.sqrt(variance[i] + shared)
                rho = 1.0 / (1.0 + across[i] * across[i] / (bound * bound))
                weight[i] = each * rho * rho / variance[i]
        fit_lines_to_matches(matches, normal, total)
    share_errors(first, surfel, shared_variances(matches, shared, surplus, normal.shape[0]), weight)
    fit_lines_to_matches(matches, normal, total)


@kernel
def fit_lines_to_matches(matches, normal, total):
    """Lines through the weighted end points of each surfel: normal (surfels, 2) is turned, the end points' distances
    across and along are then those from the line and from its middle;  total (2 surfels,) out: see `weigh_points`."""
    surfel, across, along, weight = matches.surfel, matches.across, matches.along, matches.weight
    n = normal.shape[0]
    sums, middle = np.zeros((n, 5)), np.zeros((n, 2))
    for i in range(surfel.shape[0]):
        if surfel[i] >= 0:
            m, w = sums[surfel[i]], weight[i]
            m[0] += w
            m[1] += w * along[i]
            m[2] += w * across[i]
            m[3] += w * along[i] * along[i]
            m[4] += w * along[i] * across[i]
    cos, sin = np.ones(n), np.zeros(n)
    for e in range(n):
        w, s, d, ss, sd = sums[e]
        total[e], total[n + e] = w, SLOPE_PRECISION
        if w > 0.0:
            s, d = s / w, d / w
            slope = (sd - w * s * d) / (ss - w * s * s + SLOPE_PRECISION)
            cos[e] = 1.0 / np.sqrt(1.0 + slope * slope)
            sin[e] = slope * cos[e]
            middle[e, 0], middle[e, 1] = s, d
            nx, ny = normal[e]
            normal[e, 0], normal[e, 1] = cos[e] * nx + sin[e] * ny, cos[e] * ny - sin[e] * nx
    for i in range(surfel.shape[0]):
        e = surfel[i]
        if e >= 0:
            s, d = along[i] - middle[e, 0], across[i] - middle[e, 1]
            along[i], across[i] = cos[e] * s + sin[e] * d, cos[e] * d - sin[e] * s
            total[n + e] += weight[i] * along[i] * along[i]


@kernel
def shared_variances(matches, shared, surplus, surfels):
    """Variances (surfels,) that the end points of one scan share [m^2]: `shared`, or by how much all end points of the
    surfel scatter more about its line than by their noise, since where it is no straight line, each scan sees another
    part of it."""
    surfel, across, variance, weight = matches.surfel, matches.across, matches.variance, matches.weight
    out, total = np.zeros(surfels), np.zeros(surfels)
    for i in range(surfel.shape[0]):
        if surfel[i] >= 0:
            total[surfel[i]] += weight[i]
            out[surfel[i]] += weight[i] * (across[i] * across[i] - (variance[i] - surplus))
    for e in range(surfels):
        out[e] = max(shared, out[e] / total[e]) if total[e] > 0.0 else shared
    return out


@kernel
def share_errors(first, surfel, shared, weight):
    """Reduce the weights w of the end points of a scan on surfel e by 1 / (1 + shared[e] sum w): their mean then has
    the variance shared[e] + 1 / sum w. shared (surfels,) [m^2]"""
    of_scan = np.zeros(shared.shape[0])
    for scan in range(first.shape[0] - 1):
        for i in range(first[scan], first[scan + 1]):
            if surfel[i] >= 0:
                of_scan[surfel[i]] = 0.0
        for i in range(first[scan], first[scan + 1]):
            if surfel[i] >= 0:
                of_scan[surfel[i]] += weight[i]
        for i in range(first[scan], first[scan + 1]):
            if surfel[i] >= 0:
                weight[i] /= 1.0 + shared[surfel[i]] * of_scan[surfel[i]]
