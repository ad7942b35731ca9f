# SPDX-License-Identifier: MIT
"""De-skew: undoing the robot's motion during a scan, whose beams are measured from one pose after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2


def exp_twist(twist: ArrayLike, seconds: ArrayLike) -> se2.Pose:
    """Pose (..., 3) reached from the origin at constant twist `(vx, vy, omega)` after `seconds` (...,).

    The exponential map of SE(2), Sola et al. (2018), equation 158.
    """
    twist, seconds = np.asarray(twist, dtype=np.float64), np.asarray(seconds, dtype=np.float64)
    angle = twist[2] * seconds
    # sin(a)/a and (1 - cos(a))/a with their limits at 0
    s = np.sinc(angle / np.pi)
    c = np.sinc(angle / (2.0 * np.pi)) * np.sin(angle / 2.0)
    x, y = twist[0] * seconds, twist[1] * seconds
    return np.stack([s * x - c * y, c * x + s * y, angle], axis=-1)


def deskewed_mounts(mount: ArrayLike, twist: ArrayLike, seconds: NDArray[np.float64]) -> se2.Pose:
    """Pose of the lidar at each beam (beams, 3), seen from the robot at time 0, for a robot at constant twist.

    mount: `T_robot_lidar` (3,);  twist: `(vx, vy, omega)` [m/s, m/s, rad/s];  seconds (beams,): time of each beam [s]
    """
    return se2.compose(exp_twist(twist, seconds), mount)


def log_twist(motion: ArrayLike, seconds: float) -> se2.Pose:
    """Constant twist `(vx, vy, omega)` that makes a motion (3,) in `seconds`: the inverse of `exp_twist`.

    The logarithm of SE(2), Sola et al. (2018), equation 162; for turns below 360 degrees.
    """
    x, y, angle = np.asarray(motion, dtype=np.float64).tolist()
    half = 0.5 * angle
    stretch = 1.0 if abs(half) < 1e-9 else half / np.tan(half)
    return np.array([stretch * x + half * y, stretch * y - half * x, angle]) / seconds
