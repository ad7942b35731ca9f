# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled proposals: steps II and III, where the next pose is drawn from, and what the draw adds to the weight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._array_kernels import copy_values
from slam._jit import kernel
from slam._planar_kernels import cholesky, solve, wrap_angle
from slam.matching._likelihood_kernels import end_points, scan_costs, walls_of
from slam.motion._odometry_model_kernels import motion_cost, sample_motion

IMPROVED, SCAN_MATCH, MOTION = 0, 1, 2
LOG_2PI = np.log(2.0 * np.pi)


class Laplace(NamedTuple):
    """Gaussian about an optimum of the cost, and where about it the K poses are drawn."""

    optimum: NDArray[np.float64]
    """(3,)."""
    factor: NDArray[np.float64]
    """Cholesky factor of the Hessian there, (3, 3)."""
    scale: float
    """Standard deviation of the K poses in units of the Laplace approximation's."""
    half_width: NDArray[np.float64]
    """Half the width of the interval from which the poses are drawn evenly [m, m, rad], (3,); 0 = from the Gaussian."""


@kernel
def draw_offset(L, z, scale, out):
    """out (3,) = scale * L^-T z: a draw from N(0, scale^2 (L L^T)^-1)."""
    for i in range(2, -1, -1):
        total = z[i]
        for k in range(i + 1, 3):
            total -= L[k, i] * out[k]
        out[i] = total / L[i, i]
    for i in range(3):
        out[i] *= scale


@kernel
def log_density_at_optimum(laplace):
    """log q at the optimum: of the widened Gaussian, or of the interval."""
    L, width = laplace.factor, laplace.half_width
    if width[0] > 0.0:
        return -np.log(8.0 * width[0] * width[1] * width[2])
    return np.log(L[0, 0]) + np.log(L[1, 1]) + np.log(L[2, 2]) - 1.5 * LOG_2PI - 3.0 * np.log(laplace.scale)


@kernel
def draw_near_optimum(laplace, z, out):
    """out (3,) = offset from the optimum by the variates z (3,); returns by how much log q is lower there."""
    if laplace.half_width[0] > 0.0:
        for a in range(3):
            out[a] = laplace.half_width[a] * z[a]
        return 0.0
    draw_offset(laplace.factor, z, laplace.scale, out)
    return 0.5 * (z[0] ** 2 + z[1] ** 2 + z[2] ** 2)


@kernel
def draw_poses(laplace, near, offsets, below, poses):
    """Poses (K, 3) by the variates near (K, 3), as offsets (K, 3) from the optimum too.

    below (K,) out: by how much log q is lower there
    """
    for j in range(near.shape[0]):
        below[j] = draw_near_optimum(laplace, near[j], offsets[j])
        for a in range(3):
            poses[j, a] = laplace.optimum[a] + offsets[j, a]


@kernel
def fit_gaussian(walls, guess, evidence, laplace, near, samples, weights, mean, covariance):
    """Gaussian through K weighted poses about the optimum (T-RO 2007, equations 16 to 18).

    The paper draws the poses evenly in an interval, with weights in proportion to the product. Here they come from q,
    the Laplace approximation widened by `scale`, and each is weighted by product / q, which estimates the same integral
    with far less variance; with a `half_width` they come from the interval, and q is its constant density.
    evidence: `EndPoints`, `BeamModel`, `MotionPrior`
    near (K, 3) standard normal variates, or with a `half_width` uniform ones in (-1, 1)
    samples (K, 3) out: the poses;  weights (K,) out: their weights, sum 1
    mean (3,), covariance (3, 3) out
    Returns log eta, eta the integral of p(z | m, x) p(x | x', u).
    """
    points, model, prior = evidence
    optimum = laplace.optimum
    count = near.shape[0]
    poses, costs, below = np.empty((count, 3)), np.empty(count), np.empty(count)
    log_q = log_density_at_optimum(laplace)
    draw_poses(laplace, near, samples, below, poses)  # the samples are offsets from the optimum, for now
    scan_costs(walls, poses, points, model, costs)
    top = -np.inf
    for j in range(count):
        costs[j] += motion_cost(prior, guess, poses[j, 0], poses[j, 1], poses[j, 2])
        weights[j] = -costs[j] - log_q + below[j]  # logarithms, for now
        top = max(top, weights[j])
    total = 0.0
    mean[:] = 0.0
    for j in range(count):
        weights[j] = np.exp(weights[j] - top)
        total += weights[j]
        for a in range(3):
            mean[a] += weights[j] * samples[j, a]
    for a in range(3):
        mean[a] /= total
    for j in range(count):
        weights[j] /= total
    covariance[:] = 0.0
    for j in range(count):
        for a in range(3):
            for b in range(3):
                covariance[a, b] += weights[j] * (samples[j, a] - mean[a]) * (samples[j, b] - mean[b])
    for j in range(count):
        for a in range(3):
            samples[j, a] += optimum[a]
        samples[j, 2] = wrap_angle(samples[j, 2])
    for a in range(3):
        mean[a] += optimum[a]
    mean[2] = wrap_angle(mean[2])
    return top + np.log(total / count)


@kernel
def sample_motions(start, stop, guesses, prior, draws, out):
    """Draw poses out (particles, 3) of particles [start, stop) from the motion model; guesses (particles, 3)."""
    for i in range(start, stop):
        sample_motion(guesses[i], prior, draws, i, out[i])


@kernel
def propose(start, stop, grids, guesses, evidence, settings, sampled, matches, draws, out):
    """New poses of particles [start, stop) from their optima, and what they add to the log-weights.

    guesses (particles, 3) by odometry;  sampled (particles, 3) by the motion model;  matches: `Matches`
    """
    hits, model, prior = evidence
    points = end_points(hits)
    factor, offset, cost = np.empty((3, 3)), np.empty(3), np.empty(1)
    for i in range(start, stop):
        walls, guess, pose, L = walls_of(grids, i), guesses[i], matches.optimum[i], matches.factor[i]
        out.matched[i] = 0.0
        out.failed[i] = False
        out.samples[i] = np.nan
        out.sample_weights[i] = np.nan
        if settings.kind != MOTION:
            out.matched[i] = matches.matched[i]
            out.failed[i] = not (out.matched[i] >= settings.fail_share and hits.shape[0] > 0)
        if settings.kind == MOTION or out.failed[i]:
            copy_values(sampled[i], out.pose[i])
            scan_costs(walls, sampled[i : i + 1], points, model, cost)
            out.log_gain[i] = -cost[0]
            copy_values(guess, out.mean[i])
            for a in range(3):
                for b in range(3):
                    out.covariance[i, a, b] = 0.0
            cos, sin = np.cos(guess[2]), np.sin(guess[2])
            along, across = 1.0 / prior.precision[0, 0], 1.0 / prior.precision[0, 1]
            out.covariance[i, 0, 0] = along * cos * cos + across * sin * sin
            out.covariance[i, 1, 1] = along * sin * sin + across * cos * cos
            out.covariance[i, 0, 1] = out.covariance[i, 1, 0] = (along - across) * cos * sin
            out.covariance[i, 2, 2] = 1.0 / prior.precision[0, 2]
        elif settings.kind == SCAN_MATCH:
            copy_values(pose, out.pose[i])
            copy_values(pose, out.mean[i])
            for a in range(3):  # columns of the inverse Hessian, from its Cholesky factor
                offset[:] = 0.0
                offset[a] = 1.0
                solve(L, offset)
                copy_values(offset, out.covariance[i, a])
            scan_costs(walls, matches.optimum[i : i + 1], points, model, cost)
            out.log_gain[i] = -cost[0]
        else:
            laplace = Laplace(pose, L, settings.sample_scale, settings.half_width)
            log_eta = fit_gaussian(
                walls,
                guess,
                (points, model, prior),
                laplace,
                draws.near,
                out.samples[i],
                out.sample_weights[i],
                out.mean[i],
                out.covariance[i],
            )
            out.log_gain[i] = log_eta - np.log(matches.probability[i])  # one optimum of several was drawn
            if cholesky(out.covariance[i], factor):
                for a in range(3):
                    out.pose[i, a] = out.mean[i, a]
                    for b in range(a + 1):
                        out.pose[i, a] += factor[a, b] * draws.error[i, b]
            else:  # too few poses carry weight for a covariance of full rank: Laplace's approximation instead
                draw_offset(L, draws.error[i], 1.0, offset)
                out.pose[i, 0], out.pose[i, 1], out.pose[i, 2] = (
                    pose[0] + offset[0],
                    pose[1] + offset[1],
                    pose[2] + offset[2],
                )
            out.pose[i, 2] = wrap_angle(out.pose[i, 2])
