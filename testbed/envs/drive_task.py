# SPDX-License-Identifier: MIT
"""The task of `testbed/Drive-v0` for any number of robots: drive far without a collision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.random import Generator
from numpy.typing import NDArray

from slam.se2 import Pose, between
from testbed.envs.rewards import DriveReward
from testbed.envs.scenario.robot_io import RobotIO
from testbed.envs.scenario.scenario import PreparedWorld, ResetOptions
from testbed.envs.settings import EnvironmentSettings, check_type
from testbed.seeds import RunSeeds
from testbed.simulation.fleet.robot_group import Readings


class StepOutcome(NamedTuple):
    """The result of one period; rows are robots."""

    observation: dict[str, NDArray[np.float32]]
    """Arrays (robots, …)."""
    reward: NDArray[np.float64]
    """(robots,)"""
    terminated: NDArray[np.bool_]
    """(robots,)"""
    pose: Pose
    """`T_world_robot`, (robots, 3)."""


class DriveTask:
    """Robots that drive for a reward, each in its own episode."""

    def __init__(self, robots: int, settings: EnvironmentSettings, reward: DriveReward) -> None:
        check_type("reward", reward, (DriveReward,), "a DriveReward or None")
        setup = settings.robot_setup()
        self.io = RobotIO(setup)
        self.observation_space = spaces.Dict(self.io.observation_spaces)
        """Space of the observations of one robot."""
        self.scenario = settings.scenario(setup)
        self.worlds: list[PreparedWorld | None] = [None] * robots
        """The world of each robot; None before its first episode."""
        self.readings: Readings | None = None
        """Readings of the last period; None before the first."""
        self._group = settings.group(robots, setup)
        self._reward = reward
        self._robots = robots
        self._odometry, self._truth = np.zeros((robots, 3)), np.zeros((robots, 3))

    def place(self, robot: int, rng: Generator, options: ResetOptions) -> None:
        """Begin an episode of one robot; it stands still in the first period, which gives its first scan."""
        world, start = self.scenario.draw(rng, options)
        self._group.place(robot, world.terrain, start, RunSeeds.from_seed(int(rng.integers(2**63))))
        self.worlds[robot] = world
        self._odometry[robot], self._truth[robot] = 0.0, start

    def step(self, targets: NDArray[np.float64], which: Sequence[int] | NDArray[np.intp] | None = None) -> StepOutcome:
        """Steer robots to speeds [m/s] and turn rates [rad/s], (robots, 2), for one period.

        which: indices of these robots, default: all; the rows of all others are undefined
        """
        moved = np.arange(self._robots) if which is None else np.asarray(which, dtype=np.intp)
        readings = self._group.step(targets, moved)
        observation = self.io.observe(readings, self._odometry)
        motion = between(self._truth, readings.truth)
        ahead = motion[:, 0] * np.cos(0.5 * motion[:, 2]) + motion[:, 1] * np.sin(0.5 * motion[:, 2])
        weights = self._reward
        reward = weights.ahead * ahead - weights.turn * np.abs(motion[:, 2]) - weights.collision * readings.contact
        self._odometry[moved], self._truth[moved] = readings.odometry[moved], readings.truth[moved]
        self.readings = readings
        return StepOutcome(observation, reward, readings.contact, readings.truth)

    def info(self, outcome: StepOutcome, robot: int) -> dict[str, Any]:
        """Return the info of one robot."""
        return {"pose": outcome.pose[robot].copy(), "collided": bool(outcome.terminated[robot])}

    def close(self) -> None:
        """Free physics clients."""
        self._group.close()
