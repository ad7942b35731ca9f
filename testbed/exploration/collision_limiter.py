# SPDX-License-Identifier: MIT
"""Limits the speed so that the robot can stop before obstacles in the latest scan; the map is not used."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.simulation.drivers.driver import DriverConfig

CLEARANCE_AHEAD = 0.05
"""Distance kept from obstacles ahead after braking [m]."""
CLEARANCE_SIDE = 0.02
"""Distance kept from obstacles that the robot passes [m]."""
LATENCY = 0.15
"""Age of a scan when the command takes effect [s]: the duration of a scan and half a control period."""


class CollisionLimiter:
    """Limits the forward speed of one robot."""

    def __init__(self, robot: RobotPreset, config: DriverConfig) -> None:
        self._radius = robot.footprint_radius
        self._braking = min(config.acceleration, robot.max_acceleration)

    def room_ahead(self, obstacles: NDArray[np.float64]) -> float:
        """Return how far the robot could drive straight ahead [m]; obstacles (n, 2) [m], robot's frame."""
        x, y = obstacles[:, 0], obstacles[:, 1]
        half_width = self._radius + CLEARANCE_SIDE
        in_the_way = (x > 0.0) & (np.abs(y) < half_width)
        if not in_the_way.any():
            return float("inf")
        touching = x[in_the_way] - np.sqrt(np.maximum(self._radius**2 - y[in_the_way] ** 2, 0.0))
        return float(touching.min()) - CLEARANCE_AHEAD

    def limited(self, speed: float, obstacles: NDArray[np.float64]) -> float:
        """Return the speed [m/s], limited so that the robot stops in time; backward speeds are not limited."""
        if speed <= 0.0:
            return speed
        room = max(self.room_ahead(obstacles), 0.0)
        a = self._braking
        # room = v * latency + v² / (2 a)
        max_speed = -a * LATENCY + float(np.sqrt((a * LATENCY) ** 2 + 2.0 * a * room)) if np.isfinite(room) else speed
        return min(speed, max_speed)
