# SPDX-License-Identifier: MIT
"""The interface of all backends: moving a robot and casting rays."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

STEP_RATE = 240
"""Steps of motion in a second [Hz]; it is PyBullet's default, and turns are inexact with fewer."""


class Motion(NamedTuple):
    """Result of some steps of motion."""

    poses: NDArray[np.float64]
    """`T_world_robot` after each step, (steps, 3), headings unwrapped within the array."""
    wheels: NDArray[np.float64]
    """Angles of the left and the right wheel since the beginning [rad], after the last step, (2,)."""
    contact: bool
    """Whether the robot touched a wall."""


class Hits(NamedTuple):
    """The surfaces that rays hit."""

    distances: NDArray[np.float64]
    """Distances from the origins to the first surfaces [m], (rays,); inf = none within reach."""
    cos_incidence: NDArray[np.float64]
    """Cosine of the angle between ray and the surface's normal, (rays,); 1 = head on, 0 = along the surface;
    undefined where nothing was hit."""


class AccelerationLimits(NamedTuple):
    """Largest accelerations of the motor controllers."""

    acceleration: float
    """Forward acceleration [m/s²]."""
    turn_acceleration: float
    """Turn acceleration [rad/s²]."""


class Backend(Protocol):
    """A world with one robot in it."""

    def drive(self, speed: float, turn_rate: float, steps: int) -> Motion:
        """Steer towards that speed [m/s] and turn rate [rad/s] for a number of steps of 1 / `STEP_RATE` s."""
        ...

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64], reach: float, height: float) -> Hits:
        """Cast horizontal rays.

        origins (rays, 2) [m], directions (rays,) [rad]: in the world's frame; reach: length of the rays [m]; height:
        above the floor [m], that of one of the robot's lidars
        """
        ...

    def close(self) -> None:
        """Free all resources; the backend cannot be used any more."""
        ...


def ramp(begin: float, target: float, slope: float, steps: int) -> NDArray[np.float64]:
    """Return the values after each of `steps` steps from `begin` to `target`, which change by at most `slope` per
    second."""
    reach = slope / STEP_RATE * np.arange(1, steps + 1)
    change: NDArray[np.float64] = begin + np.clip(target - begin, -reach, reach)
    return change
