# SPDX-License-Identifier: MIT
"""The driver that follows the world's tour.

It steers by the true pose, as a person with a joystick would: what is driven then does not depend on the estimator.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.simulation.drivers.driver import DriverConfig
from testbed.simulation.drivers.pursuit import PurePursuit
from testbed.simulation.drivers.stuck_recovery import StuckRecovery


class TourDriver:
    """Follows a path by pure pursuit, backs off if stuck, gives up if that does not help."""

    def __init__(self, path: NDArray[np.float64], robot: RobotPreset, config: DriverConfig) -> None:
        """path: corners (n, 2) [m], world frame. Raises `ValueError` if it has fewer than two different corners."""
        self._pursuit = PurePursuit(path, robot, config)
        self._recovery = StuckRecovery(config.patience)
        self._max_recoveries = config.max_recoveries

    @property
    def length(self) -> float:
        """Length of the whole tour [m]."""
        return self._pursuit.length

    @property
    def share(self) -> float:
        """Share of the tour that is behind the robot, 0 to 1."""
        return self._pursuit.share

    @property
    def finished(self) -> bool:
        """The end of the tour is reached."""
        return self._pursuit.finished

    @property
    def stuck(self) -> bool:
        """Backing off did not help."""
        return self.recoveries > self._max_recoveries

    @property
    def recoveries(self) -> int:
        """How often the robot had to back off."""
        return self._recovery.count

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float]:
        """Speed [m/s] and turn rate [rad/s] for the robot at this pose and time [s]."""
        speed, turn_rate = self._pursuit.command(x, y, theta)
        if self.finished:
            return 0.0, 0.0
        escape = self._recovery.command(stamp, x, y, theta)
        return escape if escape is not None else (speed, turn_rate)

    def wait(self, stamp: float) -> tuple[float, float]:
        """The command to stand still, with the reason elsewhere: time [s] spent so does not count as being stuck."""
        self._recovery.wait(stamp)
        return 0.0, 0.0
