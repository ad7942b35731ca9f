# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the motion model: its cost -log p(x | x', u), the cost's derivatives, and samples of it."""

from __future__ import annotations

import numpy as np

from slam._jit import inlined, kernel
from slam._planar_kernels import deviation, from_guess


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
def sample_motion(guess, prior, draws, particle, failure_share, out):
    """Draw a pose out (3,) from the motion model about the guess (3,), with the variates of one particle."""
    j = 1 if draws.component[particle] < failure_share else 0
    z = draws.pose[particle]
    from_guess(
        guess,
        z[0] / np.sqrt(prior.precision[j, 0]),
        z[1] / np.sqrt(prior.precision[j, 1]),
        z[2] / np.sqrt(prior.precision[j, 2]),
        out,
    )
