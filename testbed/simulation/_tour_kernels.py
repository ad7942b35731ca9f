# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Several control periods of one robot on its tour in one call, by the kernels that make one period."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._array_kernels import copy_values
from slam._jit import kernel
from testbed.simulation.drivers._pursuit_kernels import is_finished, is_stuck, steer
from testbed.simulation.physics._motion_kernels import drive
from testbed.simulation.robot._odometry_kernels import read_wheels


class Drive(NamedTuple):
    """What a robot did in some control periods, to be filled in."""

    commands: NDArray[np.float64]
    """Speed [m/s] and turn rate [rad/s] of each period, (periods, 2)."""
    poses: NDArray[np.float64]
    """`T_world_robot` after each step, (periods, steps, 3)."""
    odometry: NDArray[np.float64]
    """`T_odom_robot` after each period, (periods, 3)."""


@kernel
def drive_tour(tour, progress, body, odometer, done, first, period):
    """Drive on along a tour until `done` is full, the tour ends or the robot is given up; return the number of periods
    and whether the robot touched a wall.

    tour, progress: a `Tour` and its `TourState`; body: a `Body`; odometer: an `Odometer`; done: a `Drive`; first:
    number of the first period; period: its duration [s]
    """
    contact, n = False, done.commands.shape[0]
    for k in range(n):
        x, y, theta = body.state[0], body.state[1], body.state[2]
        speed, turn_rate = steer(tour, progress, (first + k) * period, (x, y, theta))
        speed = min(max(speed, -body.max_speed), body.max_speed)
        turn_rate = min(max(turn_rate, -body.max_turn_rate), body.max_turn_rate)
        done.commands[k, 0], done.commands[k, 1] = speed, turn_rate
        contact |= drive(body.state, (speed, turn_rate), body.step_time, body.vehicle, body.solid, done.poses[k])
        read_wheels(
            odometer.state,
            (body.state[5], body.state[6]),
            odometer.uniform[k],
            odometer.normal[k],
            odometer.believed,
            odometer.encoders,
        )
        copy_values(odometer.state, done.odometry[k])
        if is_finished(tour, progress) or is_stuck(tour, progress):
            n = k + 1
            break
    return n, contact
