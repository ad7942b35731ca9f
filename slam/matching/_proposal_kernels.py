# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled proposals: where the next pose of each particle is drawn from, and what the draw adds to its weight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import kernel
from slam._planar_kernels import cholesky, from_guess, solve, wrap_angle
from slam.matching._gauss_newton_kernels import gauss_newton
from slam.matching._likelihood_kernels import scan_cost
from slam.motion._odometry_model_kernels import motion_cost, sample_motion

IMPROVED, SCAN_MATCH, MOTION = 0, 1, 2
LOG_2PI = np.log(2.0 * np.pi)


class Laplace(NamedTuple):
    """Gaussian about an optimum of the cost, from which the K poses are drawn."""

    optimum: NDArray[np.float64]
    """(3,)."""
    factor: NDArray[np.float64]
    """Cholesky factor of the Hessian there, (3, 3)."""
    scale: float
    """Standard deviation of the K poses in units of the Laplace approximation's."""


@kernel
def best_start(grids, particle, guess, prior, search, distances, pose):
    """Start pose (3,) of the lowest cost under the coarse beam model; the predicted pose itself where none is better.

    Returns whether it is another one than the predicted pose.
    """
    other = np.empty(3)
    pose[:] = guess
    lowest = scan_cost(grids, particle, guess[0], guess[1], guess[2], search.coarse_hits, search.coarse, distances)
    lowest += motion_cost(prior, guess, guess[0], guess[1], guess[2])
    moved = False
    for k in range(search.starts.shape[0]):
        from_guess(guess, search.starts[k, 0], search.starts[k, 1], search.starts[k, 2], other)
        cost = scan_cost(grids, particle, other[0], other[1], other[2], search.coarse_hits, search.coarse, distances)
        cost += motion_cost(prior, guess, other[0], other[1], other[2])
        if cost < lowest:
            lowest = cost
            pose[:] = other
            moved = True
    return moved


@kernel
def match(grids, particle, guess, evidence, search, distances, pose, L):
    """Lowest local minimum of the cost: from the predicted pose and, where another start looks better, from there too.

    Returns the cost and the share of the hits near a wall; pose (3,) and L (3, 3) as in `gauss_newton`.
    """
    start = np.empty(3)
    moved = best_start(grids, particle, guess, evidence.prior, search, distances, start)
    cost, near = gauss_newton(grids, particle, guess, guess, evidence, search.iterations, pose, L)
    if moved:
        other, other_L = np.empty(3), np.empty((3, 3))
        other_cost, other_near = gauss_newton(
            grids, particle, guess, start, evidence, search.iterations, other, other_L
        )
        if other_cost < cost:
            cost, near = other_cost, other_near
            pose[:] = other
            L[:] = other_L
    return cost, near / max(evidence.hits.shape[0], 1)


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
def fit_gaussian(grids, particle, guess, evidence, laplace, near, samples, mean, covariance):
    """Gaussian through K weighted poses about the optimum (T-RO 2007, equations 16 to 18).

    The paper draws the poses evenly in an interval; here they come from q, the Laplace approximation widened by
    `scale`, and each is weighted by product / q, which estimates the same integral with far less variance.
    near (K, 3) standard normal variates;  samples (K, 3) out: the poses;  mean (3,), covariance (3, 3) out
    Returns log eta, eta the integral of p(z | m, x) p(x | x', u).
    """
    hits, model, prior = evidence
    optimum, L, scale = laplace
    count = near.shape[0]
    logs, distances = np.empty(count), np.empty((4, hits.shape[0]))
    log_q = np.log(L[0, 0]) + np.log(L[1, 1]) + np.log(L[2, 2]) - 1.5 * LOG_2PI - 3.0 * np.log(scale)
    top = -np.inf
    for j in range(count):
        offset = samples[j]  # from the optimum, for now
        draw_offset(L, near[j], scale, offset)
        x, y, theta = optimum[0] + offset[0], optimum[1] + offset[1], optimum[2] + offset[2]
        cost = scan_cost(grids, particle, x, y, theta, hits, model, distances)
        cost += motion_cost(prior, guess, x, y, theta)
        z2 = near[j, 0] ** 2 + near[j, 1] ** 2 + near[j, 2] ** 2
        logs[j] = -cost - log_q + 0.5 * z2
        top = max(top, logs[j])
    total = 0.0
    mean[:] = 0.0
    for j in range(count):
        logs[j] = np.exp(logs[j] - top)
        total += logs[j]
        for a in range(3):
            mean[a] += logs[j] * samples[j, a]
    mean /= total
    covariance[:] = 0.0
    for j in range(count):
        for a in range(3):
            for b in range(3):
                covariance[a, b] += logs[j] / total * (samples[j, a] - mean[a]) * (samples[j, b] - mean[b])
    for j in range(count):
        for a in range(3):
            samples[j, a] += optimum[a]
        samples[j, 2] = wrap_angle(samples[j, 2])
    for a in range(3):
        mean[a] += optimum[a]
    mean[2] = wrap_angle(mean[2])
    return top + np.log(total / count)


@kernel
def match_particles(start, stop, grids, guesses, evidence, search, draws, out):
    """Optimum of p(z | m, x) p(x | x', u) of particles [start, stop), from the starting points along the heading.

    guesses (particles, 3) predicted poses;  out: `Matches`.  `SCAN_MATCH`: the predicted pose is replaced by a sample
    of the motion model, about which the motion prior then lies. The optimum goes where the scan points and stays at
    the sample where the scan says nothing.
    """
    distances = np.empty((4, evidence.hits.shape[0]))
    for i in range(start, stop):
        out.share[i] = 1.0
        sample_motion(guesses[i], evidence.prior, draws, i, out.sample[i])
        if search.kind != MOTION:
            predicted = out.sample[i] if search.kind == SCAN_MATCH else guesses[i]
            out.cost[i], out.matched[i] = match(
                grids, i, predicted, evidence, search, distances, out.optimum[i], out.factor[i]
            )


@kernel
def match_from(start, stop, grids, guesses, evidence, iterations, starts, wanted, draws, out):
    """Match the wanted ones of particles [start, stop) from further starting points, and draw one of the optima.

    wanted (particles,);  starts (n, 3) seen from the predicted poses;  out: `Matches`, its optima the first candidates.
    Each optimum is drawn with the share of its mode in the integral of the product, by Laplace's approximation.
    """
    n = starts.shape[0]
    pose, L = np.empty((n + 1, 3)), np.empty((n + 1, 3, 3))
    cost, matched, log_mass = np.empty(n + 1), np.empty(n + 1), np.empty(n + 1)
    origin = np.empty(3)
    for i in range(start, stop):
        if not wanted[i]:
            continue
        pose[0], L[0], cost[0], matched[0] = out.optimum[i], out.factor[i], out.cost[i], out.matched[i]
        modes = 1
        for k in range(n):
            from_guess(guesses[i], starts[k, 0], starts[k, 1], starts[k, 2], origin)
            cost[modes], near = gauss_newton(
                grids, i, guesses[i], origin, evidence, iterations, pose[modes], L[modes]
            )
            matched[modes] = near / max(evidence.hits.shape[0], 1)
            if np.isfinite(cost[modes]) and is_new_mode(pose, L, modes):
                modes += 1
        top, total = -np.inf, 0.0
        for j in range(modes):
            log_mass[j] = -cost[j] - np.log(L[j, 0, 0]) - np.log(L[j, 1, 1]) - np.log(L[j, 2, 2])
            top = max(top, log_mass[j])
        for j in range(modes):
            log_mass[j] = np.exp(log_mass[j] - top)
            total += log_mass[j]
        u, chosen = draws.mode[i] * total, 0
        while chosen + 1 < modes and u >= log_mass[chosen]:
            u -= log_mass[chosen]
            chosen += 1
        out.optimum[i], out.factor[i] = pose[chosen], L[chosen]
        out.cost[i], out.matched[i] = cost[chosen], matched[chosen]
        out.share[i] = log_mass[chosen] / total


@kernel
def is_new_mode(pose, L, count):
    """Whether optimum number `count` is more than three standard deviations away from all before it."""
    for j in range(count):
        d0, d1 = pose[count, 0] - pose[j, 0], pose[count, 1] - pose[j, 1]
        d2 = wrap_angle(pose[count, 2] - pose[j, 2])
        z0 = L[j, 0, 0] * d0 + L[j, 1, 0] * d1 + L[j, 2, 0] * d2
        z1 = L[j, 1, 1] * d1 + L[j, 2, 1] * d2
        z2 = L[j, 2, 2] * d2
        if z0 * z0 + z1 * z1 + z2 * z2 < 9.0:
            return False
    return True


@kernel
def propose(start, stop, grids, guesses, evidence, search, draws, matches, out):
    """New poses of particles [start, stop) from their optima, and what they add to the log-weights; guesses
    (particles, 3); matches: `Matches`; out: `ProposalResult`."""
    hits, model, prior = evidence
    factor, offset = np.empty((3, 3)), np.empty(3)
    distances = np.empty((4, hits.shape[0]))
    for i in range(start, stop):
        guess, pose, L = guesses[i], matches.optimum[i], matches.factor[i]
        out.matched[i] = 0.0
        out.failed[i] = False
        out.samples[i] = np.nan
        if search.kind != MOTION:
            out.matched[i] = matches.matched[i]
            out.failed[i] = not (out.matched[i] >= search.fail_share and hits.shape[0] > 0)
        if search.kind == MOTION or out.failed[i]:
            out.pose[i] = matches.sample[i]
            x, y, theta = matches.sample[i]
            out.log_gain[i] = -scan_cost(grids, i, x, y, theta, hits, model, distances)
            out.mean[i] = guess
            for a in range(3):
                for b in range(3):
                    out.covariance[i, a, b] = 0.0
            cos, sin = np.cos(guess[2]), np.sin(guess[2])
            along, across = 1.0 / prior.precision[0, 0], 1.0 / prior.precision[0, 1]
            out.covariance[i, 0, 0] = along * cos * cos + across * sin * sin
            out.covariance[i, 1, 1] = along * sin * sin + across * cos * cos
            out.covariance[i, 0, 1] = out.covariance[i, 1, 0] = (along - across) * cos * sin
            out.covariance[i, 2, 2] = 1.0 / prior.precision[0, 2]
        elif search.kind == SCAN_MATCH:
            out.pose[i] = pose
            out.mean[i] = pose
            for a in range(3):  # columns of the inverse Hessian, from its Cholesky factor
                offset[:] = 0.0
                offset[a] = 1.0
                solve(L, offset)
                out.covariance[i, a] = offset
            out.log_gain[i] = -scan_cost(grids, i, pose[0], pose[1], pose[2], hits, model, distances)
        else:
            laplace = Laplace(pose, L, search.sample_scale)
            log_eta = fit_gaussian(
                grids, i, guess, evidence, laplace, draws.near, out.samples[i], out.mean[i], out.covariance[i]
            )
            out.log_gain[i] = log_eta - np.log(matches.share[i])
            if cholesky(out.covariance[i], factor):
                for a in range(3):
                    out.pose[i, a] = out.mean[i, a]
                    for b in range(a + 1):
                        out.pose[i, a] += factor[a, b] * draws.pose[i, b]
            else:  # too few poses carry weight for a covariance of full rank: Laplace's approximation instead
                draw_offset(L, draws.pose[i], 1.0, offset)
                out.pose[i] = pose + offset
            out.pose[i, 2] = wrap_angle(out.pose[i, 2])
