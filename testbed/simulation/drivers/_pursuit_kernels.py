# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Pure pursuit of a polyline: the position along it and the arc that leads back to it."""

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
