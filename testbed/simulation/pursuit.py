# SPDX-License-Identifier: MIT
"""Following a path by pure pursuit.

Source: R. C. Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.simulation.driver import DriverConfig

_ARRIVED = 0.05
"""Distance to the end of the path at which it is finished [m]."""


class PurePursuit:
    """Follows a polyline to its end, slows down in bends, turns on the spot at sharp corners."""

    def __init__(self, path: NDArray[np.float64], robot: RobotPreset, config: DriverConfig) -> None:
        """path: corners (n, 2) [m]. Raises `ValueError` if it has fewer than two different corners."""
        corners = [(float(x), float(y)) for x, y in path]
        corners = corners[:1] + [b for a, b in pairwise(corners) if a != b]
        if len(corners) < 2:
            raise ValueError("a path needs at least one way point besides the start")
        self._corners = corners
        self._lengths = [math.dist(a, b) for a, b in pairwise(corners)]
        self._starts = [0.0, *np.cumsum(self._lengths).tolist()]
        self._config = config
        self._speed, self._turn_rate = min(config.speed, robot.max_speed), min(config.turn_rate, robot.max_turn_rate)
        self._along = 0.0

    @property
    def length(self) -> float:
        """Length of the whole path [m]."""
        return float(self._starts[-1])

    @property
    def share(self) -> float:
        """Share of the path that is behind the robot, 0 to 1."""
        return self._along / self.length

    @property
    def finished(self) -> bool:
        """The end of the path is reached."""
        return self.length - self._along < _ARRIVED

    def command(self, x: float, y: float, theta: float) -> tuple[float, float]:
        """Speed [m/s] and turn rate [rad/s] for the robot at this pose, in the path's frame."""
        self._advance(x, y)
        if self.finished:
            return 0.0, 0.0
        goal_x, goal_y = self._point(self._along + self._config.lookahead)
        distance = math.hypot(goal_x - x, goal_y - y)
        bearing = math.remainder(math.atan2(goal_y - y, goal_x - x) - theta, 2.0 * math.pi)
        return self._pursue(distance, bearing)

    def _pursue(self, distance: float, bearing: float) -> tuple[float, float]:
        if abs(bearing) > self._config.turn_on_spot_above:
            return 0.0, math.copysign(min(self._turn_rate, 2.0 * abs(bearing)), bearing)
        braking = math.sqrt(2.0 * self._config.acceleration * max(self.length - self._along, 0.5 * _ARRIVED))
        speed = min(self._speed, braking) * math.cos(bearing)
        curvature = 2.0 * math.sin(bearing) / max(distance, 0.5 * self._config.lookahead)
        if abs(curvature) * speed > self._turn_rate:
            speed = self._turn_rate / abs(curvature)
        return speed, curvature * speed

    def _advance(self, x: float, y: float) -> None:
        """Move on to the point of the path nearest to the robot, no farther than twice the lookahead from the last."""
        low, high = self._along, self._along + 2.0 * self._config.lookahead
        best, best_along = math.inf, low
        for k in range(self._leg(low), self._leg(high) + 1):
            begin, length = self._starts[k], self._lengths[k]
            (ax, ay), (bx, by) = self._corners[k], self._corners[k + 1]
            t = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length
            t = min(max(t, low - begin, 0.0), high - begin, length)
            px, py = ax + (bx - ax) * t / length, ay + (by - ay) * t / length
            away = math.hypot(x - px, y - py)
            if away < best - 1e-9:
                best, best_along = away, begin + t
        self._along = best_along

    def _leg(self, along: float) -> int:
        """Number of the leg that holds the point at that distance from the beginning of the path."""
        return min(bisect_right(self._starts, along) - 1, len(self._lengths) - 1)

    def _point(self, along: float) -> tuple[float, float]:
        """The point of the path at that distance from its beginning, or its end."""
        k = self._leg(along)
        t = min((along - self._starts[k]) / self._lengths[k], 1.0)
        (ax, ay), (bx, by) = self._corners[k], self._corners[k + 1]
        return ax + t * (bx - ax), ay + t * (by - ay)
