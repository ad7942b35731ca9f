# SPDX-License-Identifier: MIT
"""Rigid motions of the plane. A pose is `(x, y, theta)` [m, m, rad]; all functions take batches `(..., 3)`.

`T_a_b` is the pose of frame b seen from frame a; `compose(T_a_b, T_b_c)` is `T_a_c`.
Operators as in Lu and Milios (1997): compose is the head-to-tail operator, `between(a, b) = inverse(a) (+) b`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Pose = NDArray[np.float64]


def wrap_angle(angle: ArrayLike) -> NDArray[np.float64]:
    """Angle [rad] in [-pi, pi), any shape."""
    wrap_angle: NDArray[np.float64] = (np.asarray(angle, dtype=np.float64) + np.pi) % (2.0 * np.pi) - np.pi
    return wrap_angle


def compose(T_a_b: ArrayLike, T_b_c: ArrayLike) -> Pose:
    """`T_a_c` (..., 3) from `T_a_b` (..., 3) and `T_b_c` (..., 3); shapes broadcast."""
    a, b = np.asarray(T_a_b, dtype=np.float64), np.asarray(T_b_c, dtype=np.float64)
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    T_a_c: Pose = a + b  # filled: np.stack takes longer than the arithmetic of a single pose
    T_a_c[..., 0] = a[..., 0] + cos * b[..., 0] - sin * b[..., 1]
    T_a_c[..., 1] = a[..., 1] + sin * b[..., 0] + cos * b[..., 1]
    T_a_c[..., 2] = wrap_angle(T_a_c[..., 2])
    return T_a_c


def inverse(T_a_b: ArrayLike) -> Pose:
    """`T_b_a` (..., 3) from `T_a_b` (..., 3)."""
    a = np.asarray(T_a_b, dtype=np.float64)
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack(
        [
            -cos * a[..., 0] - sin * a[..., 1],
            sin * a[..., 0] - cos * a[..., 1],
            wrap_angle(-a[..., 2]),
        ],
        axis=-1,
    )


def between(T_w_a: ArrayLike, T_w_b: ArrayLike) -> Pose:
    """`T_a_b` (..., 3): the pose of b seen from a, both given in the same frame w."""
    a, b = np.asarray(T_w_a, dtype=np.float64), np.asarray(T_w_b, dtype=np.float64)
    T_a_b: Pose = b - a
    dx, dy = T_a_b[..., 0].copy(), T_a_b[..., 1].copy()
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    T_a_b[..., 0] = cos * dx + sin * dy
    T_a_b[..., 1] = -sin * dx + cos * dy
    T_a_b[..., 2] = wrap_angle(T_a_b[..., 2])
    return T_a_b


def transform_points(T_a_b: ArrayLike, points_b: ArrayLike) -> NDArray[np.float64]:
    """Points `(..., n, 2)` [m] of frame b, seen from frame a; `T_a_b` (..., 3)."""
    a, p = np.asarray(T_a_b, dtype=np.float64), np.asarray(points_b, dtype=np.float64)
    cos, sin = np.cos(a[..., None, 2]), np.sin(a[..., None, 2])
    x = a[..., None, 0] + cos * p[..., 0] - sin * p[..., 1]
    points_a = np.empty((*x.shape, 2))  # filled: np.stack takes as long as the arithmetic
    points_a[..., 0] = x
    points_a[..., 1] = a[..., None, 1] + sin * p[..., 0] + cos * p[..., 1]
    return points_a


def rotation(angle: ArrayLike) -> NDArray[np.float64]:
    """Matrices (..., 3, 3) that turn displacements `(x, y, theta)` by angles (...,) [rad]: the adjoint of a turn."""
    angle = np.asarray(angle, dtype=np.float64)
    turn = np.zeros((*angle.shape, 3, 3))
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(angle)
    turn[..., 1, 0] = np.sin(angle)
    turn[..., 0, 1] = -turn[..., 1, 0]
    turn[..., 2, 2] = 1.0
    return turn
