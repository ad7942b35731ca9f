# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the motion model: its cost -log p(x | x', u), the cost's derivatives, and samples of it."""

from __future__ import annotations

import numpy as np

from slam._jit import inlined, kernel
from slam._planar_kernels import deviation, from_guess


@inlined
def log_components(precision, log_scale, along, across, turn):
    """Log density of each of the three components of a motion prior, (3, 3) and (3,), at a deviation."""
    a, c, t = along * along, across * across, turn * turn
    return (
        log_scale[0] - 0.5 * (precision[0, 0] * a + precision[0, 1] * c + precision[0, 2] * t),
        log_scale[1] - 0.5 * (precision[1, 0] * a + precision[1, 1] * c + precision[1, 2] * t),
        log_scale[2] - 0.5 * (precision[2, 0] * a + precision[2, 1] * c + precision[2, 2] * t),
    )


@inlined
def cost_of_components(good, failed, jumped):
    """Negative logarithm of a sum of three densities that are given as logarithms [nats]."""
    top = max(good, failed, jumped)
    return -top - np.log(np.exp(good - top) + np.exp(failed - top) + np.exp(jumped - top))


@kernel
def motion_cost(prior, guess, x, y, theta):
    """-log p(x | x', u) [nats]."""
    along, across, turn = deviation(guess, x, y, theta)
    good, failed, jumped = log_components(prior.precision, prior.log_scale, along, across, turn)
    return cost_of_components(good, failed, jumped)


@kernel
def linearise_motion(prior, guess, x, y, theta, H, g):
    """Cost of the motion prior; adds its gradient to g (3,) and its Hessian to H (3, 3).

    The Hessian is that of the Gaussians with their shares at this pose held fixed (one step of expectation
    maximisation), so it is always positive definite.
    """
    along, across, turn = deviation(guess, x, y, theta)
    good, failed, jumped = log_components(prior.precision, prior.log_scale, along, across, turn)
    cost = cost_of_components(good, failed, jumped)
    first, second, third = np.exp(good + cost), np.exp(failed + cost), np.exp(jumped + cost)
    pa = first * prior.precision[0, 0] + second * prior.precision[1, 0] + third * prior.precision[2, 0]
    pc = first * prior.precision[0, 1] + second * prior.precision[1, 1] + third * prior.precision[2, 1]
    pt = first * prior.precision[0, 2] + second * prior.precision[1, 2] + third * prior.precision[2, 2]
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
def sample_motion(guess, prior, draws, particle, out):
    """Draw a pose out (3,) from the motion model about the guess (3,), with the variates of one particle."""
    u, j = draws.component[particle], 0
    if u < prior.share[1]:
        j = 1
    elif u >= 1.0 - prior.share[2]:
        j = 2
    z = draws.motion[particle]
    from_guess(
        guess,
        z[0] / np.sqrt(prior.precision[j, 0]),
        z[1] / np.sqrt(prior.precision[j, 1]),
        z[2] / np.sqrt(prior.precision[j, 2]),
        out,
    )
