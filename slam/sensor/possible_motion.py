# SPDX-License-Identifier: MIT
"""What no robot does: wheels that slip, or an encoder that jumps, report such velocities all the same."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

MAX_SPEED, MAX_TURN_RATE = 10.0, 4.0 * math.pi
"""No robot with a 2D lidar moves faster [m/s], [rad/s]."""


def are_impossible(twists: ArrayLike) -> NDArray[np.bool_]:
    """Whether velocities (..., 3) [m/s, m/s, rad/s] are more than any robot reaches, (...)."""
    forward, sideways, turn = np.moveaxis(np.abs(np.asarray(twists, dtype=np.float64)), -1, 0)
    fast: NDArray[np.bool_] = (np.maximum(forward, sideways) > MAX_SPEED) | (turn > MAX_TURN_RATE)
    return fast


def possible_twist(twist: ArrayLike | None) -> NDArray[np.float64] | None:
    """The velocity (3,) [m/s, m/s, rad/s]; None where it is unknown, or more than any robot reaches."""
    return None if twist is None or are_impossible(twist) else np.asarray(twist, dtype=np.float64)
