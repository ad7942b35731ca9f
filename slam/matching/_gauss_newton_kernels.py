# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled scan matching: the local minimum of the cost -log p(z | m, x) p(x | x', u) by Gauss-Newton."""

from __future__ import annotations

import numpy as np

from slam._array_kernels import copy_values
from slam._jit import kernel
from slam._planar_kernels import cholesky, solve
from slam.matching._likelihood_kernels import linearise_scan
from slam.motion._odometry_model_kernels import linearise_motion

MIN_TRANSLATION, MIN_ROTATION = 1e-3, 5e-4
"""Steps below 1 mm and 0.5 mrad end the search: a fiftieth of a cell, and as much at 2 m, of what the map resolves."""
MIN_IMPROVEMENT = 1e-6
"""Costs [nats] that differ by less count as equal: round-off of a sum over a thousand beams stays far below."""


@kernel
def gauss_newton(walls, guess, start, evidence, iterations, pose, L):
    """Local minimum of the cost from `start` (3,) by Gauss-Newton with step halving.

    evidence: `EndPoints`, `BeamModel`, `MotionPrior`
    The last step, of less than a millimetre, is taken unseen, and the cost after it is that of the quadratic form.
    pose (3,) out: the optimum;  L (3, 3) out: Cholesky factor of the Hessian before the last step
    Returns the cost and the number of end points near a wall.
    """
    points, model, prior = evidence
    H, g, step = np.empty((3, 3)), np.empty(3), np.zeros(3)
    x, y, theta = start[0], start[1], start[2]
    best = np.inf
    best_near = 0
    for _ in range(iterations):
        H[:] = 0.0
        g[:] = 0.0
        cost = linearise_motion(prior, guess, x, y, theta, H, g)
        scan, near = linearise_scan(walls, points, x, y, theta, model, H, g)
        cost += scan
        improved = cost < best - MIN_IMPROVEMENT
        if improved:
            best, best_near = cost, near
            pose[0], pose[1], pose[2] = x, y, theta
            if not cholesky(H, L):
                break
            copy_values(g, step)
            solve(L, step)
        else:
            for a in range(3):
                step[a] *= 0.5
        if abs(step[0]) < MIN_TRANSLATION and abs(step[1]) < MIN_TRANSLATION and abs(step[2]) < MIN_ROTATION:
            if improved:
                for a in range(3):
                    pose[a] -= step[a]
                    best -= 0.5 * g[a] * step[a]
            break
        x, y, theta = pose[0] - step[0], pose[1] - step[1], pose[2] - step[2]
    return best, best_near
