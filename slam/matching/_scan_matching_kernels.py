# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled scan matching: step I of the proposal, the optimum of p(z | m, x) p(x | x', u) for each particle."""

from __future__ import annotations

import numpy as np

from slam._array_kernels import copy_matrix, copy_values
from slam._jit import kernel
from slam._planar_kernels import deviation, from_guess, wrap_angle
from slam.matching._gauss_newton_kernels import gauss_newton
from slam.matching._likelihood_kernels import end_points, scan_costs, walls_of
from slam.motion._odometry_model_kernels import motion_cost

SAME_MODE = 9.0
"""Two optima within three standard deviations of each other count as one (squared Mahalanobis distance)."""


@kernel
def best_start(walls, guess, prior, coarse, search, pose):
    """Start pose (3,) of the lowest cost under the coarse beam model; the predicted pose itself where none is better.

    coarse: `EndPoints` of the coarse hits
    Returns whether it is another one than the predicted pose.
    """
    count = search.starts.shape[0] + 1
    poses, costs = np.empty((count, 3)), np.empty(count)
    copy_values(guess, poses[0])
    for k in range(1, count):
        from_guess(guess, search.starts[k - 1, 0], search.starts[k - 1, 1], search.starts[k - 1, 2], poses[k])
    scan_costs(walls, poses, coarse, search.coarse, costs)
    best = 0
    for k in range(count):
        costs[k] += motion_cost(prior, guess, poses[k, 0], poses[k, 1], poses[k, 2])
        if costs[k] < costs[best]:
            best = k
    copy_values(poses[best], pose)
    return best > 0


@kernel
def match(walls, guess, evidence, coarse, search, pose, L):
    """Lowest local minimum of the cost: from the predicted pose and, where another start looks better, from there too.

    Returns the cost and the share of the hits near a wall; evidence, pose (3,) and L (3, 3) as in `gauss_newton`.
    """
    start = np.empty(3)
    moved = best_start(walls, guess, evidence[2], coarse, search, start)
    cost, near = gauss_newton(walls, guess, guess, evidence, search.iterations, pose, L)
    if moved:
        other, other_L = np.empty(3), np.empty((3, 3))
        other_cost, other_near = gauss_newton(walls, guess, start, evidence, search.iterations, other, other_L)
        if other_cost < cost:
            cost, near = other_cost, other_near
            copy_values(other, pose)
            copy_matrix(other_L, L)
    return cost, near / max(evidence[0].x.shape[0], 1)


@kernel
def is_new_mode(pose, L, count):
    """Whether optimum number `count` is more than three standard deviations away from all before it."""
    for j in range(count):
        d0, d1 = pose[count, 0] - pose[j, 0], pose[count, 1] - pose[j, 1]
        d2 = wrap_angle(pose[count, 2] - pose[j, 2])
        z0 = L[j, 0, 0] * d0 + L[j, 1, 0] * d1 + L[j, 2, 0] * d2
        z1 = L[j, 1, 1] * d1 + L[j, 2, 1] * d2
        z2 = L[j, 2, 2] * d2
        if z0 * z0 + z1 * z1 + z2 * z2 < SAME_MODE:
            return False
    return True


@kernel
def gain_of_jump(evidence, predicted, optimum, matched):
    """What a jump could gain at most over an optimum near the predicted pose [nats]: a bound.

    At best a jump makes all beams match that now end far from all walls, and leaves the others as they are. It is
    charged what the third component of the prior charges more than the prior at the optimum.
    """
    hits, beams, prior = evidence
    worst = 0.5 * beams.weight * beams.per_sigma2 * beams.far**2 / (1.0 + beams.far**2 * beams.per_outlier2)
    gain = worst * hits.shape[0] * (1.0 - matched)
    return gain + prior.log_scale[2] + motion_cost(prior, predicted, optimum[0], optimum[1], optimum[2])


@kernel
def match_particles(start, stop, grids, predicted, evidence, search, out):
    """Optimum of p(z | m, x) p(x | x', u) of particles [start, stop), from the starting points along the heading.

    predicted (particles, 3), about which the motion prior lies;  out: `Matches`
    """
    scan, coarse = (end_points(evidence.hits), evidence.beams, evidence.prior), end_points(search.coarse_hits)
    for i in range(start, stop):
        walls, optimum, factor = walls_of(grids, i), out.optimum[i], out.factor[i]
        out.probability[i] = 1.0
        out.cost[i], out.matched[i] = match(walls, predicted[i], scan, coarse, search, optimum, factor)
        out.jump_gain[i] = gain_of_jump(evidence, predicted[i], out.optimum[i], out.matched[i])


@kernel
def find_modes(walls, predicted, evidence, iterations, starts, pose, L, cost, matched, mass):
    """Optima reached from further starting points, each once, with the mass of each mode by Laplace's approximation.

    evidence as in `gauss_newton`
    starts (n, 3) seen from the predicted pose (3,);  pose (n + 1, 3), L (n + 1, 3, 3), cost (n + 1,), matched (n + 1,):
    the first row is known, the others are out;  mass (n + 1,) out: share in the integral of the product
    Returns the number of optima.
    """
    origin, modes = np.empty(3), 1
    for k in range(starts.shape[0]):
        from_guess(predicted, starts[k, 0], starts[k, 1], starts[k, 2], origin)
        cost[modes], near = gauss_newton(walls, predicted, origin, evidence, iterations, pose[modes], L[modes])
        matched[modes] = near / max(evidence[0].x.shape[0], 1)
        if np.isfinite(cost[modes]) and is_new_mode(pose, L, modes):
            modes += 1
    top, total = -np.inf, 0.0
    for j in range(modes):
        mass[j] = -cost[j] - np.log(L[j, 0, 0]) - np.log(L[j, 1, 1]) - np.log(L[j, 2, 2])
        top = max(top, mass[j])
    for j in range(modes):
        mass[j] = np.exp(mass[j] - top)
        total += mass[j]
    for j in range(modes):
        mass[j] /= total
    return modes


@kernel
def likely_starts(grids, particle, predicted, evidence, iterations, starts, matches, least, out):
    """Those optima in the map of one particle, seen from its predicted pose (3,), whose mode has at least the share
    `least` of the mass, and which are not the one in matches: out (n, 3); returns how many there are."""
    n = starts.shape[0] + 1
    pose, L, cost, matched, mass = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty(n), np.empty(n), np.empty(n)
    copy_values(matches.optimum[particle], pose[0])
    copy_matrix(matches.factor[particle], L[0])
    cost[0], matched[0] = matches.cost[particle], matches.matched[particle]
    walls, scan = walls_of(grids, particle), (end_points(evidence.hits), evidence.beams, evidence.prior)
    modes = find_modes(walls, predicted, scan, iterations, starts, pose, L, cost, matched, mass)
    count = 0
    for j in range(1, modes):
        if mass[j] >= least:
            out[count, 0], out[count, 1], out[count, 2] = deviation(predicted, pose[j, 0], pose[j, 1], pose[j, 2])
            count += 1
    return count


@kernel
def match_from(start, stop, grids, predicted, evidence, iterations, starts, wanted, u, out):
    """Match the wanted ones of particles [start, stop) from further starting points, and draw one of the optima.

    wanted (particles,);  starts (n, 3) seen from the predicted poses;  u (particles,) uniform variates in [0, 1)
    out: `Matches`; its optima are the first candidates. An optimum is drawn with the share of its mode in the integral
    of the product: particles stand in each of several optima of like value.
    """
    n, scan = starts.shape[0] + 1, (end_points(evidence.hits), evidence.beams, evidence.prior)
    pose, L, cost, matched, mass = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty(n), np.empty(n), np.empty(n)
    for i in range(start, stop):
        if not wanted[i]:
            continue
        copy_values(out.optimum[i], pose[0])
        copy_matrix(out.factor[i], L[0])
        cost[0], matched[0] = out.cost[i], out.matched[i]
        walls = walls_of(grids, i)
        modes = find_modes(walls, predicted[i], scan, iterations, starts, pose, L, cost, matched, mass)
        left, chosen = u[i], 0
        while chosen + 1 < modes and left >= mass[chosen]:
            left -= mass[chosen]
            chosen += 1
        copy_values(pose[chosen], out.optimum[i])
        copy_matrix(L[chosen], out.factor[i])
        out.cost[i], out.matched[i] = cost[chosen], matched[chosen]
        out.probability[i] = mass[chosen]
