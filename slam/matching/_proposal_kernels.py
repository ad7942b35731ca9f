# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled part of the proposals: for each particle, where the next pose is drawn from and what that is worth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import kernel
from slam.matching._likelihood_kernels import BeamModel, cholesky, descend, motion_cost, scan_cost, solve, wrapped

IMPROVED, SCAN_MATCH, MOTION = 0, 1, 2
LOG_2PI = np.log(2.0 * np.pi)


class Draws(NamedTuple):
    """All random numbers of one step, drawn whichever of them are used."""

    near: NDArray[np.float64]
    """Standard normal variates for the poses about the optimum, (K, 3); common to all particles, which makes their
    weights comparable at small K."""
    pose: NDArray[np.float64]
    """Standard normal variates for the new pose, (particles, 3)."""
    component: NDArray[np.float64]
    """Uniform variates in [0, 1) that choose the component of the motion model, (particles,)."""


class Search(NamedTuple):
    """How the optimum is looked for."""

    kind: int
    iterations: int
    starts: NDArray[np.float64]
    """Further starting points seen from the predicted pose, (n, 3)."""
    coarse: BeamModel
    """Beam model with a wide basin, by which starting points are compared."""
    coarse_hits: NDArray[np.float64]
    """Some of the hits, evenly chosen, for that comparison, (n, 2)."""
    fail_share: float
    """Share of the hits near a wall below which matching has failed."""
    second_share: float
    """Share of the second component of the motion prior."""
    spread: float
    """Standard deviation of the K poses in units of the Laplace approximation's."""


class Laplace(NamedTuple):
    """Gaussian about an optimum of the cost, from which the K poses are drawn."""

    optimum: NDArray[np.float64]
    """(3,)."""
    factor: NDArray[np.float64]
    """Cholesky factor of the Hessian there, (3, 3)."""
    spread: float
    """Standard deviation in units of the Laplace approximation's."""


class Proposed(NamedTuple):
    """What the proposals made of the particles."""

    pose: NDArray[np.float64]
    """New poses, (particles, 3)."""
    log_gain: NDArray[np.float64]
    """What is added to each log-weight: log eta, or the log-likelihood where the motion model was sampled."""
    mean: NDArray[np.float64]
    """Mean of the fitted Gaussian, (particles, 3)."""
    covariance: NDArray[np.float64]
    """Covariance of the fitted Gaussian in the map's frame, (particles, 3, 3)."""
    matched: NDArray[np.float64]
    """Share of the hits near a wall, (particles,)."""
    failed: NDArray[np.bool_]
    """Whether matching failed, (particles,)."""
    samples: NDArray[np.float64]
    """The K poses drawn about the optimum, (particles, K, 3); NaN where none were drawn."""


@kernel
def from_guess(guess, along, across, turn, out):
    """Pose out (3,) at a deviation seen from the guess (3,)."""
    cos, sin = np.cos(guess[2]), np.sin(guess[2])
    out[0] = guess[0] + cos * along - sin * across
    out[1] = guess[1] + sin * along + cos * across
    out[2] = wrapped(guess[2] + turn)


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

    Returns the cost and the share of the hits near a wall; pose (3,) and L (3, 3) as in `descend`.
    """
    start = np.empty(3)
    moved = best_start(grids, particle, guess, evidence.prior, search, distances, start)
    cost, near = descend(grids, particle, guess, guess, evidence, search.iterations, pose, L)
    if moved:
        other, other_L = np.empty(3), np.empty((3, 3))
        other_cost, other_near = descend(grids, particle, guess, start, evidence, search.iterations, other, other_L)
        if other_cost < cost:
            cost, near = other_cost, other_near
            pose[:] = other
            L[:] = other_L
    return cost, near / max(evidence.hits.shape[0], 1)


@kernel
def sample_motion(guess, prior, draws, particle, second_share, out):
    """Draw a pose out (3,) from the motion model."""
    j = 1 if draws.component[particle] < second_share else 0
    z = draws.pose[particle]
    from_guess(
        guess,
        z[0] / np.sqrt(prior.precision[j, 0]),
        z[1] / np.sqrt(prior.precision[j, 1]),
        z[2] / np.sqrt(prior.precision[j, 2]),
        out,
    )


@kernel
def offset_of(L, z, scale, out):
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
    `spread`, and each is weighted by product / q, which estimates the same integral with far less variance.
    near (K, 3) standard normal variates;  samples (K, 3) out: the poses;  mean (3,), covariance (3, 3) out
    Returns log eta, eta the integral of p(z | m, x) p(x | x', u).
    """
    hits, model, prior = evidence
    optimum, L, spread = laplace
    count = near.shape[0]
    logs, distances = np.empty(count), np.empty((4, hits.shape[0]))
    log_q = np.log(L[0, 0]) + np.log(L[1, 1]) + np.log(L[2, 2]) - 1.5 * LOG_2PI - 3.0 * np.log(spread)
    top = -np.inf
    for j in range(count):
        offset = samples[j]  # from the optimum, for now
        offset_of(L, near[j], spread, offset)
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
        samples[j, 2] = wrapped(samples[j, 2])
    for a in range(3):
        mean[a] += optimum[a]
    mean[2] = wrapped(mean[2])
    return top + np.log(total / count)


@kernel
def propose(start, stop, grids, guesses, evidence, search, draws, out):
    """New poses of particles [start, stop) and what they add to the log-weights; guesses (particles, 3).

    `SCAN_MATCH`: the predicted pose is replaced by a sample of the motion model, about which the motion prior then
    lies. The optimum goes where the scan points and stays at the sample where the scan says nothing.
    """
    hits, model, prior = evidence
    pose, L, factor, offset = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    sample = np.empty(3)
    distances = np.empty((4, hits.shape[0]))
    for i in range(start, stop):
        guess = guesses[i]
        out.failed[i] = False
        out.matched[i] = 0.0
        out.samples[i] = np.nan
        sample_motion(guess, prior, draws, i, search.second_share, sample)
        if search.kind != MOTION:
            predicted = sample if search.kind == SCAN_MATCH else guess
            _, out.matched[i] = match(grids, i, predicted, evidence, search, distances, pose, L)
            out.failed[i] = not (out.matched[i] >= search.fail_share and hits.shape[0] > 0)
        if search.kind == MOTION or out.failed[i]:
            out.pose[i] = sample
            x, y, theta = sample
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
            laplace = Laplace(pose, L, search.spread)
            out.log_gain[i] = fit_gaussian(
                grids, i, guess, evidence, laplace, draws.near, out.samples[i], out.mean[i], out.covariance[i]
            )
            if cholesky(out.covariance[i], factor):
                for a in range(3):
                    out.pose[i, a] = out.mean[i, a]
                    for b in range(a + 1):
                        out.pose[i, a] += factor[a, b] * draws.pose[i, b]
            else:  # too few poses carry weight for a covariance of full rank: Laplace's approximation instead
                offset_of(L, draws.pose[i], 1.0, offset)
                out.pose[i] = pose + offset
            out.pose[i, 2] = wrapped(out.pose[i, 2])
