# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Geometry of the plane and 3 x 3 algebra for kernels: the compiled counterparts of `slam.se2`."""

from __future__ import annotations

import numpy as np

from slam._jit import inlined, kernel


@inlined
def wrap_angle(angle):
    """Angle in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@inlined
def deviation(guess, x, y, theta):
    """Pose (x, y, theta) seen from the guess (3,): along, across [m], heading [rad]."""
    cos, sin = np.cos(guess[2]), np.sin(guess[2])
    dx, dy = x - guess[0], y - guess[1]
    return cos * dx + sin * dy, -sin * dx + cos * dy, wrap_angle(theta - guess[2])


@kernel
def from_guess(guess, along, across, turn, out):
    """Pose out (3,) at a deviation seen from the guess (3,)."""
    cos, sin = np.cos(guess[2]), np.sin(guess[2])
    out[0] = guess[0] + cos * along - sin * across
    out[1] = guess[1] + sin * along + cos * across
    out[2] = wrap_angle(guess[2] + turn)


@inlined
def principal_axes(cxx, cxy, cyy):
    """Angle of the larger principal axis of a symmetric 2 x 2 matrix [rad], its smaller and its larger eigenvalue."""
    mid, half = 0.5 * (cxx + cyy), np.sqrt(0.25 * (cxx - cyy) ** 2 + cxy * cxy)
    return 0.5 * np.arctan2(2.0 * cxy, cxx - cyy), mid - half, mid + half


@kernel
def cholesky(A, L):
    """Lower Cholesky factor L of a symmetric 3 x 3 matrix; returns False where A is not positive definite."""
    for i in range(3):
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                L[i, i] = np.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
        for j in range(i + 1, 3):
            L[i, j] = 0.0
    return True


@kernel
def solve(L, x):
    """Solve L L^T y = x; y is written over x (3,)."""
    for i in range(3):
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    for i in range(2, -1, -1):
        for k in range(i + 1, 3):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]
