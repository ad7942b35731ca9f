# SPDX-License-Identifier: MIT
"""Path following by pure pursuit.

Source: R. C. Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.simulation.drivers._pursuit_kernels import Path, PursuitLimits, pursue
from testbed.simulation.drivers.driver import DriverConfig

_ARRIVED = 0.05
"""The path is finished within this distance of its end [m]."""


class PurePursuit:
    """Follows a polyline to its end, slows down in bends, turns on the spot at sharp corners."""

    def __init__(self, path: NDArray[np.float64], robot: RobotPreset, config: DriverConfig) -> None:
        """path: corners (n, 2) [m]. Raises `ValueError` if it has fewer than two different corners."""
        corners = np.array(path, dtype=np.float64)
        differs = np.append(True, (np.diff(corners, axis=0) != 0.0).any(axis=1))
        corners = np.ascontiguousarray(corners[differs])
        if len(corners) < 2:
            raise ValueError("a path needs at least two different corners")
        lengths = np.hypot(*np.diff(corners, axis=0).T)
        self.path = Path(corners, np.append(0.0, np.cumsum(lengths)))
        """The polyline."""
        self.limits = PursuitLimits(
            speed=min(config.speed, robot.max_speed),
            turn_rate=min(config.turn_rate, robot.max_turn_rate),
            acceleration=config.acceleration,
            lookahead=config.lookahead,
            turn_on_spot_above=config.turn_on_spot_above,
            arrived=_ARRIVED,
        )
        """Limits of the motion."""
        self.along = np.zeros(1)
        """Position along the path [m], (1,)."""
        self.length = float(self.path.starts[-1])
        """Length of the whole path [m]."""

    @property
    def share(self) -> float:
        """Share of the path that is done, 0 to 1."""
        return float(self.along[0]) / self.length

    @property
    def finished(self) -> bool:
        """Whether the end of the path is reached."""
        return bool(self.length - self.along[0] < _ARRIVED)

    def command(self, x: float, y: float, theta: float) -> tuple[float, float]:
        """Return speed [m/s] and turn rate [rad/s] for the robot at this pose in the path's frame; 0, 0 at the end."""
        speed, turn_rate, self.along[0] = pursue(self.path, self.along[0], (x, y, theta), self.limits)
        return speed, turn_rate
