# SPDX-License-Identifier: MIT
"""What every simulation backend does: move a robot by wheel commands, and cast rays among the walls."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

STEP_RATE = 240
"""Steps of motion in a second [Hz]; PyBullet's default, below which turns become inexact."""


class Motion(NamedTuple):
    """What happened in some steps of motion."""

    poses: NDArray[np.float64]
    """`T_world_robot` after each step, (steps, 3), headings unwrapped within the array."""
    wheels: NDArray[np.float64]
    """Angles turned by the left and the right wheel since the beginning [rad], after the last step, (2,)."""
    contact: bool
    """The robot touched a wall or a mover."""


class Hits(NamedTuple):
    """Where rays ended."""

    distances: NDArray[np.float64]
    """From the origin to the first surface [m], (rays,); inf where there is none within reach."""
    cos_incidence: NDArray[np.float64]
    """Cosine of the angle between ray and the surface's normal, (rays,); 1 = head on, 0 = along the surface;
    undefined where nothing was hit."""


class AccelerationLimits(NamedTuple):
    """Accelerations that motor controllers keep to."""

    acceleration: float
    """Forward [m/s²]."""
    turn_acceleration: float
    """About the vertical axis [rad/s²]."""


class Backend(Protocol):
    """A world with one robot in it."""

    def drive(self, speed: float, turn_rate: float, steps: int) -> Motion:
        """Steer towards that speed [m/s] and turn rate [rad/s] for some steps of 1 / `STEP_RATE` s."""
        ...

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64], reach: float, height: float) -> Hits:
        """Level rays from `origins` (rays, 2) [m] along `directions` (rays,) [rad], both in the world's frame, at
        `height` above the floor [m]: that of one of the robot's lidars."""
        ...

    def close(self) -> None:
        """Free everything; the backend cannot be used any more."""
        ...


def ramp(begin: float, target: float, slope: float, steps: int) -> NDArray[np.float64]:
    """Values after each of `steps` steps that go from `begin` to `target` at no more than `slope` a second."""
    reach = slope / STEP_RATE * np.arange(1, steps + 1)
    change: NDArray[np.float64] = begin + np.clip(target - begin, -reach, reach)
    return change
