# SPDX-License-Identifier: MIT
"""The task of `testbed/Drive-v0` for any number of robots: go far, do not collide. No map, no goal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.random import Generator
from numpy.typing import NDArray

from slam.se2 import Pose, between
from testbed.envs.scenario.robot_io import RobotIO
from testbed.envs.scenario.scenario import PreparedWorld, ResetOptions
from testbed.envs.settings import EnvironmentSettings
from testbed.seeds import RunSeeds
from testbed.simulation.fleet.robot_group import Readings


@dataclass(frozen=True, kw_only=True)
class DriveReward:
    """Weights of the reward, by the truth. Driving ahead is good, turning costs, as in Zamora et al. (2016), "Extending
    the OpenAI Gym for robotics", whose TurtleBot gets 5 for a step ahead, 1 for a turn, -200 for a collision."""

    ahead: float = 1.0
    """Per metre driven forward [1/m]; backward counts negative."""
    turn: float = 0.05
    """Cost per radian turned [1/rad]."""
    collision: float = 5.0
    """Cost of a collision, which ends the episode."""


class StepOutcome(NamedTuple):
    """What a period brought; rows are robots."""

    observation: dict[str, NDArray[np.float32]]
    """Arrays (robots, …), made for this period."""
    reward: NDArray[np.float64]
    """(robots,)"""
    terminated: NDArray[np.bool_]
    """(robots,)"""
    pose: Pose
    """`T_world_robot`, (robots, 3)."""


class DriveTask:
    """Robots that drive for a reward, each in an episode of its own."""

    def __init__(self, robots: int, settings: EnvironmentSettings, reward: DriveReward) -> None:
        setup = settings.robot_setup()
        self.io = RobotIO(setup)
        self.observation_space = spaces.Dict(self.io.observation_spaces)
        """Of one robot."""
        self.scenario = settings.scenario(setup)
        self.places: list[PreparedWorld | None] = [None] * robots
        """Where each robot is."""
        self.readings: Readings | None = None
        """The last ones."""
        self._group = settings.group(robots, setup)
        self._reward = reward
        self._robots = robots
        self._odometry, self._truth = np.zeros((robots, 3)), np.zeros((robots, 3))

    def place(self, robot: int, rng: Generator, wish: ResetOptions) -> None:
        """Begin an episode of one robot; it stands still in the first period, which gives it its first scan."""
        place, start = self.scenario.draw(rng, wish)
        self._group.place(robot, place.terrain, start, RunSeeds.from_seed(int(rng.integers(2**63))))
        self.places[robot] = place
        self._odometry[robot], self._truth[robot] = 0.0, start

    def step(self, targets: NDArray[np.float64], which: Sequence[int] | NDArray[np.intp] | None = None) -> StepOutcome:
        """Steer robots of these indices (default: all) to speeds [m/s] and turn rates [rad/s], (robots, 2), for one
        period. Rows of others mean nothing."""
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
        """The info of one robot."""
        return {"pose": outcome.pose[robot].copy(), "collided": bool(outcome.terminated[robot])}

    def close(self) -> None:
        """Free physics clients."""
        self._group.close()
