# SPDX-License-Identifier: MIT
"""The bumper of eyes: a robot does not drive into what its last scan shows, whatever the map says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.simulation.drivers.driver import DriverConfig

GAP = 0.05
"""Distance that is kept from obstacles ahead [m], besides what braking takes."""
SIDE_GAP = 0.02
"""Distance from obstacles that are passed [m]."""
LATENCY = 0.15
"""Age of a scan when its command takes effect [s]: a scan's time and half a control period."""


class Guard:
    """Slows a robot down before obstacles ahead."""

    def __init__(self, robot: RobotPreset, config: DriverConfig) -> None:
        self._radius = robot.footprint_radius
        self._braking = min(config.acceleration, robot.max_acceleration)

    def room_ahead(self, obstacles: NDArray[np.float64]) -> float:
        """How far the robot could drive straight on [m]; obstacles (n, 2) [m, robot's frame]."""
        x, y = obstacles[:, 0], obstacles[:, 1]
        half_width = self._radius + SIDE_GAP
        in_the_way = (x > 0.0) & (np.abs(y) < half_width)
        if not in_the_way.any():
            return float("inf")
        touching = x[in_the_way] - np.sqrt(np.maximum(self._radius**2 - y[in_the_way] ** 2, 0.0))
        return float(touching.min()) - GAP

    def limited(self, speed: float, obstacles: NDArray[np.float64]) -> float:
        """The speed [m/s], no faster than can be stopped in time; driving backward is not watched."""
        if speed <= 0.0:
            return speed
        room = max(self.room_ahead(obstacles), 0.0)
        a = self._braking
        # room = v * latency + v² / (2 a)
        fastest = -a * LATENCY + float(np.sqrt((a * LATENCY) ** 2 + 2.0 * a * room)) if np.isfinite(room) else speed
        return min(speed, fastest)
