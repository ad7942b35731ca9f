# SPDX-License-Identifier: MIT
"""Baselines that use the last scan only: a random walk and a wall follower."""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from testbed.exploration.belief import Belief
from testbed.exploration.collision_limiter import CollisionLimiter
from testbed.presets import RobotPreset
from testbed.simulation.drivers.driver import DriverConfig
from testbed.simulation.drivers.stuck_recovery import StuckRecovery

_NEAR = 0.1
"""The robot turns away if it has less room ahead than this [m]."""
_WALL_DISTANCE = 0.25
"""Distance of the footprint from the wall that is followed [m]."""
_LOOK_AHEAD = 0.6
"""Walls up to this far ahead of the footprint are followed [m]."""


class _Reactive:
    """The common part: it backs off where the robot is stuck, never finishes and never gives up."""

    finished = False
    stuck = False

    def __init__(self, robot: RobotPreset, config: DriverConfig) -> None:
        self._limiter, self._recovery = CollisionLimiter(robot, config), StuckRecovery(config.patience)
        self._radius = robot.footprint_radius
        self._speed = min(config.speed, robot.max_speed)
        self._turn_rate = min(config.turn_rate, robot.max_turn_rate)

    @property
    def recoveries(self) -> int:
        """Number of times that the robot backed off."""
        return self._recovery.count

    def wait(self, stamp: float) -> None:
        """Do not count the time up to `stamp` [s] as lack of progress."""
        self._recovery.wait(stamp)

    def command(self, belief: Belief) -> tuple[float, float]:
        """Return speed [m/s] and turn rate [rad/s]."""
        escape = self._recovery.command(belief.stamp, *belief.pose.tolist())
        speed, turn_rate = escape if escape is not None else self._react(belief)
        return self._limiter.limited(speed, turn_rate, belief), turn_rate

    def _react(self, belief: Belief) -> tuple[float, float]:
        raise NotImplementedError


class RandomWalk(_Reactive):
    """Drives straight ahead until something is in the way, then turns on the spot by a random angle."""

    def __init__(self, robot: RobotPreset, config: DriverConfig, rng: Generator) -> None:
        super().__init__(robot, config)
        self._rng = rng
        self._left_to_turn, self._heading = 0.0, 0.0

    def _react(self, belief: Belief) -> tuple[float, float]:
        theta = float(belief.pose[2])
        if self._left_to_turn != 0.0:
            turned = math.remainder(theta - self._heading, 2.0 * math.pi)
            left = self._left_to_turn - turned
            self._left_to_turn = left if left * self._left_to_turn > 0.0 else 0.0
        elif self._limiter.room_ahead(belief.obstacles()) < _NEAR:
            self._left_to_turn = float(self._rng.uniform(0.5, math.pi)) * (1.0 if self._rng.random() < 0.5 else -1.0)
        self._heading = theta
        if self._left_to_turn != 0.0:
            return 0.0, math.copysign(self._turn_rate, self._left_to_turn)
        return self._speed, 0.0


class WallFollower(_Reactive):
    """Keeps the nearest wall on the right at a constant distance, by a proportional controller."""

    def _react(self, belief: Belief) -> tuple[float, float]:
        obstacles = belief.obstacles()
        if self._limiter.room_ahead(obstacles) < _NEAR:
            return 0.0, self._turn_rate
        away = self._distance_right(obstacles)
        if math.isinf(away):  # no wall: drive a curve to the right until there is one
            return 0.5 * self._speed, -0.5 * self._turn_rate
        turn_rate = float(np.clip(3.0 * (_WALL_DISTANCE - away), -0.6, 1.0)) * self._turn_rate
        slow = 1.0 - 0.6 * abs(turn_rate) / self._turn_rate
        return slow * self._speed, turn_rate

    def _distance_right(self, obstacles: NDArray[np.float64]) -> float:
        """Return the distance from the footprint to the nearest obstacle on the right or ahead [m]; inf if none."""
        x, y = obstacles[:, 0], obstacles[:, 1]
        seen = (x > -0.5 * self._radius) & (x < self._radius + _LOOK_AHEAD) & (y < 0.3 * self._radius)
        distances = np.hypot(x, y)[seen] - self._radius
        near = distances[distances < 4.0 * _WALL_DISTANCE]
        return float(near.min()) if near.size else math.inf
