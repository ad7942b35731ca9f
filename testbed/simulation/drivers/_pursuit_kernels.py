# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Pure pursuit of a polyline: the position along it, the arc that leads back to it, and backing off when stuck."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import kernel


class Path(NamedTuple):
    """A polyline whose neighbouring corners differ."""

    corners: NDArray[np.float64]
    """Corners (x, y), (n, 2) [m]."""
    starts: NDArray[np.float64]
    """Distance of each corner from the beginning, along the path [m], (n,)."""


class PursuitLimits(NamedTuple):
    """Limits of the motion along a path; see `DriverConfig`."""

    speed: float
    turn_rate: float
    acceleration: float
    lookahead: float
    turn_on_spot_above: float
    arrived: float
    """Distance to the end at which the path is finished [m]."""


BACKING_OFF = 6
"""Size of the state of backing off: time of the last progress and until when it backs off [s]; pose x, y [m], theta
[rad] at that time, NaN at the beginning; number of times that it backed off."""
_PROGRESS, _TURN_PROGRESS = 0.05, 0.2  # motion [m] and turning [rad] that count as progress
BACK_OFF_SPEED, BACK_OFF_TIME = -0.1, 2.0
"""Speed [m/s] and duration [s] of backing off."""


class Tour(NamedTuple):
    """A path, and when the robot backs off."""

    path: Path
    limits: PursuitLimits
    patience: float
    """The robot is stuck if it has made no progress for this time [s]."""
    max_recoveries: int
    """The drive is given up after this many tries to back off."""


class TourState(NamedTuple):
    """State of a drive along a tour, changed in place."""

    along: NDArray[np.float64]
    """Position along the path [m], (1,)."""
    recovery: NDArray[np.float64]
    """See `BACKING_OFF`."""


@kernel
def _leg(path, along):
    """Return the number of the leg that holds the point `along` [m] from the beginning of the path."""
    return min(np.searchsorted(path.starts, along, side="right") - 1, path.starts.shape[0] - 2)


@kernel
def progress(path, along, reach, x, y):
    """Return the distance from the beginning [m] of the path point nearest to (x, y) [m], at least `along` and at most
    `reach` beyond it."""
    best, best_along = np.inf, along
    for k in range(_leg(path, along), _leg(path, along + reach) + 1):
        begin, length = path.starts[k], path.starts[k + 1] - path.starts[k]
        ax, ay = path.corners[k]
        dx, dy = (path.corners[k + 1, 0] - ax) / length, (path.corners[k + 1, 1] - ay) / length
        t = (x - ax) * dx + (y - ay) * dy
        t = min(max(t, along - begin, 0.0), along + reach - begin, length)
        away = np.hypot(x - ax - t * dx, y - ay - t * dy)
        if away < best - 1e-9:
            best, best_along = away, begin + t
    return best_along


@kernel
def pursue(path, along, pose, limits):
    """Return speed [m/s], turn rate [rad/s] and position along the path [m] of a robot at `pose` (3,).

    along: the previous position along the path [m]; the new one is searched up to twice the lookahead from there
    """
    x, y, theta = pose
    along = progress(path, along, 2.0 * limits.lookahead, x, y)
    left = path.starts[-1] - along
    if left < limits.arrived:
        return 0.0, 0.0, along
    k = _leg(path, along + limits.lookahead)
    t = min((along + limits.lookahead - path.starts[k]) / (path.starts[k + 1] - path.starts[k]), 1.0)
    goal_x = path.corners[k, 0] + t * (path.corners[k + 1, 0] - path.corners[k, 0])
    goal_y = path.corners[k, 1] + t * (path.corners[k + 1, 1] - path.corners[k, 1])
    distance = np.hypot(goal_x - x, goal_y - y)
    bearing = (np.arctan2(goal_y - y, goal_x - x) - theta + np.pi) % (2.0 * np.pi) - np.pi
    if abs(bearing) > limits.turn_on_spot_above:
        return 0.0, np.sign(bearing) * min(limits.turn_rate, 2.0 * abs(bearing)), along
    braking = np.sqrt(2.0 * limits.acceleration * max(left, 0.5 * limits.arrived))
    speed = min(limits.speed, braking) * np.cos(bearing)
    curvature = 2.0 * np.sin(bearing) / max(distance, 0.5 * limits.lookahead)
    if abs(curvature) * speed > limits.turn_rate:
        speed = limits.turn_rate / abs(curvature)
    return speed, curvature * speed, along


@kernel
def backs_off(recovery, stamp, pose, patience):
    """Return whether a robot at `pose` (3,) is to back off at the time `stamp` [s]; advances `recovery` in place."""
    if stamp < recovery[1]:
        return True
    turned = abs(pose[2] - recovery[4])
    turned = abs(turned - 2.0 * np.pi * np.round(turned / (2.0 * np.pi)))
    moved = np.hypot(pose[0] - recovery[2], pose[1] - recovery[3])
    if np.isnan(moved) or moved > _PROGRESS or turned > _TURN_PROGRESS:
        recovery[0], recovery[2], recovery[3], recovery[4] = stamp, pose[0], pose[1], pose[2]
    elif stamp - recovery[0] > patience:
        recovery[5] += 1.0
        recovery[0] = recovery[1] = stamp + BACK_OFF_TIME
        return True
    return False


@kernel
def steer(tour, state, stamp, pose):
    """Return speed [m/s] and turn rate [rad/s] of a robot at `pose` (3,) on a tour at the time `stamp` [s]; advances
    `state` in place."""
    speed, turn_rate, state.along[0] = pursue(tour.path, state.along[0], pose, tour.limits)
    if is_finished(tour, state):
        return 0.0, 0.0
    if backs_off(state.recovery, stamp, pose, tour.patience):
        return BACK_OFF_SPEED, 0.0
    return speed, turn_rate


@kernel
def is_finished(tour, state):
    """Return whether the end of the path is reached."""
    return tour.path.starts[-1] - state.along[0] < tour.limits.arrived


@kernel
def is_stuck(tour, state):
    """Return whether the drive was given up, because backing off did not help."""
    return state.recovery[5] > tour.max_recoveries
