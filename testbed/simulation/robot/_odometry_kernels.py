# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Kernels of the odometry: encoders, slip, integration along arcs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import kernel

ODOMETER = 10
"""Size of the state of an odometer: pose x, y [m], theta [rad]; then for the left and the right wheel each: angle spun
including slip, angle counted by the encoder, true angle at the last reading [rad]; then the part of the error of the
heading that is still to be made good [rad]."""


class Encoders(NamedTuple):
    """Sizes of the errors of odometry, zero where a layer is off, and nominal wheels of the robot."""

    radius: float
    """Nominal radius of the wheels [m]."""
    track: float
    """Nominal distance of the wheels [m]."""
    tick: float
    """Angle of one tick [rad]; 0 = the encoders read angles exactly."""
    random_translation: float
    """Random error along the path [m/sqrt(m)]."""
    random_rotation: float
    """Random error of heading [rad/sqrt(m)] and [rad/sqrt(rad)]."""
    slip_rate: float
    """Slip events per metre driven [1/m]."""
    slip_distance: float
    """Mean distance that a slipping wheel spins ahead [m]."""
    lost_ticks: float
    """Share of the motion that the encoders miss."""
    recovered_share: float
    """Share of the random error of heading that is made good again."""
    recovery_length: float
    """Way on which all but 1/e of that is made good; a radian counts as a metre [m]."""
    unsigned: bool
    """Whether driving backward is counted as driving forward."""


class Odometer(NamedTuple):
    """The odometry of a robot, with the random numbers of its next readings."""

    state: NDArray[np.float64]
    """State as `read_wheels` takes it, (10,), changed in place."""
    believed: NDArray[np.float64]
    """Radii and track that it assumes [m], (3,)."""
    encoders: Encoders
    uniform: NDArray[np.float64]
    """Uniform numbers, (readings, 3)."""
    normal: NDArray[np.float64]
    """Normal numbers, (readings, 2)."""


@kernel
def read_wheels(odometer, wheels, uniform, normal, believed, encoders):
    """Advance `odometer` (10,) in place to the wheel angles (2,) [rad] since the beginning.

    uniform (3,), normal (2,): random numbers; believed (3,): left radius, right radius and track [m] that odometry
    assumes, wrong by the systematic errors of the run
    """
    d_left, d_right = wheels[0] - odometer[7], wheels[1] - odometer[8]
    odometer[7], odometer[8] = wheels[0], wheels[1]
    distance = encoders.radius * 0.5 * abs(d_left + d_right)
    turned = encoders.radius * abs(d_right - d_left) / encoders.track
    slips = uniform[0] < -np.expm1(-encoders.slip_rate * distance)
    slip = -np.log1p(-uniform[2]) * encoders.slip_distance / encoders.radius if slips else 0.0

    left = _count(odometer, 3, d_left + (slip if uniform[1] < 0.5 else 0.0), encoders)
    right = _count(odometer, 4, d_right + (0.0 if uniform[1] < 0.5 else slip), encoders)
    s_left, s_right = believed[0] * left, believed[1] * right
    counted = 0.5 * (s_left + s_right)
    step = (abs(counted) if encoders.unsigned else counted) + encoders.random_translation * np.sqrt(distance) * normal[
        0
    ]
    error = encoders.random_rotation * np.sqrt(distance + turned) * normal[1]
    made_good = odometer[9] * -np.expm1(-(distance + turned) / encoders.recovery_length)
    odometer[9] += encoders.recovered_share * error - made_good
    turn = (s_right - s_left) / believed[2] + error - made_good
    half = 0.5 * turn  # an arc: exact for constant velocities
    chord = step * (np.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6.0)
    odometer[0] += chord * np.cos(odometer[2] + half)
    odometer[1] += chord * np.sin(odometer[2] + half)
    odometer[2] += turn


@kernel
def _count(odometer, wheel, spun, encoders):
    """Return the angle [rad] that the encoder of a wheel counts while the wheel spins by `spun` [rad]; `wheel`: its
    index in the state, 3 or 4."""
    odometer[wheel] += spun * (1.0 - encoders.lost_ticks)
    counted = odometer[wheel]
    if encoders.tick > 0.0:
        counted = np.floor(counted / encoders.tick) * encoders.tick
    change = counted - odometer[wheel + 2]
    odometer[wheel + 2] = counted
    return change
