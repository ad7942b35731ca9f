# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Motion of a differential-drive robot that follows its commands exactly, unless it meets a wall."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._array_kernels import copy_values
from slam._jit import kernel
from testbed.simulation.physics._ray_kernels import SegmentGrid


class Vehicle(NamedTuple):
    """Parameters of the motion of a robot."""

    wheel_radius: float
    half_track: float
    footprint_radius: float
    acceleration: float
    turn_acceleration: float


class Body(NamedTuple):
    """A robot on the fast backend."""

    state: NDArray[np.float64]
    """State as `drive` takes it, (7,), changed in place."""
    vehicle: Vehicle
    solid: SegmentGrid
    """Surfaces that stop the robot."""
    max_speed: float
    """Largest commanded speed [m/s]."""
    max_turn_rate: float
    """Largest commanded turn rate [rad/s]."""
    step_time: float
    """Duration of a step of motion [s]."""


@kernel
def clearance(grid, x, y, reach):
    """Return the distance [m] from (x, y) to the nearest segment of a `SegmentGrid`, at most `reach`."""
    rows, cols = grid.shape
    col_low = max(int(np.floor((x - reach - grid.origin[0]) / grid.cell)), 0)
    col_high = min(int(np.floor((x + reach - grid.origin[0]) / grid.cell)), cols - 1)
    row_low = max(int(np.floor((y - reach - grid.origin[1]) / grid.cell)), 0)
    row_high = min(int(np.floor((y + reach - grid.origin[1]) / grid.cell)), rows - 1)
    best = reach * reach
    for row in range(row_low, row_high + 1):
        for col in range(col_low, col_high + 1):
            k = row * cols + col
            for i in range(grid.first[k], grid.first[k + 1]):
                x0, y0, x1, y1 = grid.segments[i]
                ex, ey = x1 - x0, y1 - y0
                share = ((x - x0) * ex + (y - y0) * ey) / max(ex * ex + ey * ey, 1e-300)
                share = min(max(share, 0.0), 1.0)
                dx, dy = x - x0 - share * ex, y - y0 - share * ey
                best = min(best, dx * dx + dy * dy)
    return np.sqrt(best)


@kernel
def drive(state, target, step_time, vehicle, grid, poses):
    """Fill `poses` (steps, 3) with the motion, advance `state` (7,) in place, and return whether the robot touched a
    wall.

    state (7,): x, y [m], theta [rad], speed [m/s], turn rate [rad/s], left and right wheel [rad]; target (2,): speed
    [m/s] and turn rate [rad/s]; step_time [s]

    Each step is an exact arc. The pose does not change in a step that would bring a surface into the footprint, but the
    wheels turn on, as in front of a wall.
    """
    steps, contact = poses.shape[0], False
    travel = max(abs(state[3]), abs(target[0])) * steps * step_time
    near = clearance(grid, state[0], state[1], vehicle.footprint_radius + travel) <= vehicle.footprint_radius + travel
    change, turn_change = vehicle.acceleration * step_time, vehicle.turn_acceleration * step_time
    for k in range(steps):
        state[3] += min(max(target[0] - state[3], -change), change)
        state[4] += min(max(target[1] - state[4], -turn_change), turn_change)
        length, turn = state[3] * step_time, state[4] * step_time
        half = 0.5 * turn
        chord = length * (np.sin(half) / half if abs(half) > 1e-9 else 1.0)
        x, y = state[0] + chord * np.cos(state[2] + half), state[1] + chord * np.sin(state[2] + half)
        state[2] += turn
        state[5] += (length - vehicle.half_track * turn) / vehicle.wheel_radius
        state[6] += (length + vehicle.half_track * turn) / vehicle.wheel_radius
        if near and clearance(grid, x, y, vehicle.footprint_radius) < vehicle.footprint_radius:
            contact = True
        else:
            state[0], state[1] = x, y
        copy_values(state, poses[k])
    return contact
