# SPDX-License-Identifier: MIT
"""The driver that follows the tour of the world.

It steers by the true pose, so that the drive does not depend on the estimator.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.simulation.drivers._pursuit_kernels import Tour, TourState, steer
from testbed.simulation.drivers.driver import DriverConfig
from testbed.simulation.drivers.pursuit import PurePursuit
from testbed.simulation.drivers.stuck_recovery import StuckRecovery


class TourDriver:
    """Follows a path by pure pursuit; backs off where the robot is stuck, and gives up after several tries."""

    def __init__(self, path: NDArray[np.float64], robot: RobotPreset, config: DriverConfig) -> None:
        """path: corners (n, 2) [m], world frame. Raises `ValueError` if it has fewer than two different corners."""
        self._pursuit = PurePursuit(path, robot, config)
        self._recovery = StuckRecovery(config.patience)
        self.tour = Tour(self._pursuit.path, self._pursuit.limits, config.patience, config.max_recoveries)
        """The path, and when the robot backs off."""
        self.state = TourState(self._pursuit.along, self._recovery.state)
        """State of the drive."""

    @property
    def length(self) -> float:
        """Length of the whole tour [m]."""
        return self._pursuit.length

    @property
    def share(self) -> float:
        """Share of the tour that is done, 0 to 1."""
        return self._pursuit.share

    @property
    def finished(self) -> bool:
        """Whether the end of the tour is reached."""
        return self._pursuit.finished

    @property
    def stuck(self) -> bool:
        """Whether the drive was given up, because backing off did not help."""
        return self.recoveries > self.tour.max_recoveries

    @property
    def recoveries(self) -> int:
        """Number of times that the robot backed off."""
        return self._recovery.count

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float]:
        """Return speed [m/s] and turn rate [rad/s] for the robot at this pose and time [s]."""
        speed, turn_rate = steer(self.tour, self.state, stamp, (x, y, theta))
        return speed, turn_rate

    def wait(self, stamp: float) -> tuple[float, float]:
        """Return the command 0, 0; the time up to `stamp` [s] does not count as lack of progress."""
        self._recovery.wait(stamp)
        return 0.0, 0.0
