# SPDX-License-Identifier: MIT
"""Conversion of actions to velocities and of readings to observations, and the spaces of both."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction
from numpy.typing import NDArray

from slam.se2 import Pose, between
from testbed.simulation.fleet.robot_group import Readings, RobotSetup

_ODOMETRY_MARGIN = 4.0
"""Limit of odometry increments, in multiples of the robot's largest motion in a period: slipping wheels exceed it."""


class RobotIO:
    """Spaces and conversions for robots of one kind; arrays have one row per robot."""

    def __init__(self, setup: RobotSetup) -> None:
        self.setup = setup
        robot, period = setup.robot, setup.period
        self.max_velocity = np.array([robot.max_speed, robot.max_turn_rate])
        """Speed [m/s] and turn rate [rad/s] of the action (1, 1)."""
        reach = _ODOMETRY_MARGIN * period * self.max_velocity
        self._odometry_limit = np.array([reach[0], reach[0], reach[1]], dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        """Space of actions: speed and turn rate as shares of the robot's largest."""
        self.observation_spaces: dict[str, spaces.Space[Any]] = {
            "scan": spaces.Box(0.0, np.float32(setup.lidar.range_max), (setup.lidar.beams,), np.float32),
            "odometry": spaces.Box(-self._odometry_limit, self._odometry_limit, dtype=np.float32),
        }
        """Spaces of the observations that `observe` returns, for one robot."""

    def target(self, action: Any) -> NDArray[np.float64]:
        """Return the `targets` for the action of a single robot, (1, 2)."""
        return self.targets(np.asarray(action)[None] if np.ndim(action) else action, 1)

    def targets(self, actions: Any, robots: int, acting: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Return speed [m/s] and turn rate [rad/s], (robots, 2); zero for robots that are not `acting` (robots,).

        Raises `InvalidAction` for actions of wrong shape, not finite or outside of the action space.
        """
        try:
            given = np.asarray(actions, dtype=np.float64)
        except (TypeError, ValueError):
            raise InvalidAction(f"action must be numbers, got {actions!r}") from None
        if given.shape != (robots, 2):
            raise InvalidAction(f"action must be speed and turn rate for {robots} robot(s), got shape {given.shape}")
        acting = np.ones(robots, np.bool_) if acting is None else acting
        given = np.where(acting[:, None], given, 0.0)
        if not (np.abs(given) <= 1.0).all():  # NaN is not either
            raise InvalidAction(f"action must be numbers in [-1, 1], got {actions!r}")
        targets: NDArray[np.float64] = given * self.max_velocity
        return targets

    def observe(self, readings: Readings, odometry_before: Pose) -> dict[str, NDArray[np.float32]]:
        """Return the observations `scan` and `odometry`.

        `scan` (robots, beams) [m]: no return = the maximum range, nothing valid = 0. `odometry` (robots, 3): motion
        (dx, dy, dtheta) during the last period in the robot's own frame [m, m, rad].
        """
        reach = self.setup.lidar.range_max
        scan = np.nan_to_num(readings.ranges, nan=0.0, posinf=reach, neginf=0.0).astype(np.float32)
        increment = between(odometry_before, readings.odometry).astype(np.float32)
        return {
            "scan": np.clip(scan, 0.0, np.float32(reach)),
            "odometry": np.clip(increment, -self._odometry_limit, self._odometry_limit),
        }
