# SPDX-License-Identifier: MIT
"""Limits the speed so that the robot can stop before obstacles in the latest scans; the map is not used.

The predicted motion is that of the dynamic window approach (Fox, Burgard, Thrun, IEEE Robotics & Automation Magazine
4(1), 1997), up to the robot's standstill and with the ramp of the turn rate.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbed.exploration.belief import Belief
from testbed.presets import RobotPreset
from testbed.simulation.drivers.driver import DriverConfig

CLEARANCE_AHEAD = 0.05
"""Distance kept from obstacles straight ahead [m]."""
CLEARANCE = 0.025
"""Least distance from obstacles during the predicted motion [m]."""
LATENCY = 0.1
"""Longest time for which a command holds, after which the robot may brake [s]."""
_STEP = 0.02
"""Time between two poses of the predicted motion [s]."""
_SHARES = np.linspace(1.0, 0.0, 11)
"""Shares of the wanted speed that are tried."""


class CollisionLimiter:
    """Limits the speed of one robot."""

    def __init__(self, robot: RobotPreset, config: DriverConfig) -> None:
        self._radius = robot.footprint_radius
        self._braking = min(config.acceleration, robot.max_acceleration)
        self._turning = min(config.turn_acceleration, robot.max_turn_acceleration)

    def room_ahead(self, obstacles: NDArray[np.float64]) -> float:
        """Return how far the robot could drive straight ahead [m]; obstacles (n, 2) [m], robot's frame."""
        x, y = obstacles[:, 0], obstacles[:, 1]
        half_width = self._radius + CLEARANCE
        in_the_way = (x > 0.0) & (np.abs(y) < half_width)
        if not in_the_way.any():
            return float("inf")
        touching = x[in_the_way] - np.sqrt(np.maximum(self._radius**2 - y[in_the_way] ** 2, 0.0))
        return float(touching.min()) - CLEARANCE_AHEAD

    def limited(self, speed: float, turn_rate: float, belief: Belief) -> float:
        """Return the largest share of a speed [m/s] from which the robot can brake without touching an obstacle.

        turn_rate: that of the command [rad/s]. Obstacles that the lidars do not see, such as those behind a robot
        that looks ahead, do not limit the speed.
        """
        now = belief.twist if belief.twist is not None else np.array([speed, 0.0, turn_rate])
        candidates = speed * _SHARES
        # a robot that is faster than a candidate brakes from its present speed
        fastest = np.where(candidates * now[0] > 0.0, np.maximum(np.abs(candidates), abs(now[0])), np.abs(candidates))
        reach = fastest.max() * LATENCY + fastest.max() ** 2 / (2.0 * self._braking) + self._radius + CLEARANCE
        obstacles = belief.obstacles()
        distances = np.hypot(*obstacles.T)
        near = distances < reach
        if not near.any():
            return speed
        path = self._predict(np.copysign(fastest, speed), now[2], turn_rate)
        away = np.hypot(*(obstacles[near] - path[:, :, None]).transpose(3, 0, 1, 2))
        # what is nearer already, such as a wall that is left, must not come nearer still
        allowed = np.minimum(self._radius + CLEARANCE, distances[near] - 1e-6)
        clear = (away >= allowed).all(axis=(1, 2))
        return float(candidates[np.argmax(clear)]) if clear.any() else 0.0

    def _predict(self, speeds: NDArray[np.float64], turn_now: float, turn_rate: float) -> NDArray[np.float64]:
        """Return the positions (candidates, steps, 2) [m] of robots that keep a speed for `LATENCY`, then brake."""
        duration = LATENCY + np.abs(speeds).max() / self._braking
        times = np.arange(_STEP, duration + _STEP, _STEP)
        turns = turn_now + np.clip(turn_rate - turn_now, -self._turning * times, self._turning * times)
        headings = np.cumsum(turns) * _STEP
        kept = np.maximum(np.abs(speeds)[:, None] - self._braking * np.maximum(times - LATENCY, 0.0), 0.0)
        steps = np.copysign(kept, speeds[:, None])[:, :, None] * np.column_stack([np.cos(headings), np.sin(headings)])
        positions: NDArray[np.float64] = np.cumsum(steps, axis=1) * _STEP
        return positions
