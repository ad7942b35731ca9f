# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled part of the weights: moments of a few dozen particles, where numpy would spend its time on being called."""

from __future__ import annotations

import numpy as np

from slam._jit import kernel


@kernel
def mixture_covariance(poses, weights, spread, out):
    """Covariance of a weighted mixture of Gaussians, out (3, 3); see `slam.particles.weights.pose_covariance`."""
    n = poses.shape[0]
    sin, cos = 0.0, 0.0
    for i in range(n):
        sin += weights[i] * np.sin(poses[i, 2])
        cos += weights[i] * np.cos(poses[i, 2])
    heading = np.arctan2(sin, cos)
    away = np.empty((n, 3))
    mean = np.zeros(3)
    for i in range(n):
        away[i, 0], away[i, 1] = poses[i, 0], poses[i, 1]
        away[i, 2] = (poses[i, 2] - heading + np.pi) % (2.0 * np.pi) - np.pi
        for a in range(3):
            mean[a] += weights[i] * away[i, a]
    out[:] = 0.0
    for i in range(n):
        for a in range(3):
            for b in range(3):
                out[a, b] += weights[i] * (spread[i, a, b] + (away[i, a] - mean[a]) * (away[i, b] - mean[b]))
