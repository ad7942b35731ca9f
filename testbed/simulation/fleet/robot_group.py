# SPDX-License-Identifier: MIT
"""Robots that move period by period: one command in, one odometry reading and one scan out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose
from testbed.presets import LidarPreset, RobotPreset, load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation.physics.backend import STEP_RATE, AccelerationLimits
from testbed.simulation.physics.fast import segment_grid
from testbed.simulation.robot.lidar import LidarLayers
from testbed.simulation.robot.odometry import OdometryConfig
from worlds import World


@dataclass(frozen=True, kw_only=True)
class RobotSetup:
    """Robot, lidar and errors of a fleet."""

    robot: RobotPreset = field(default_factory=lambda: load_robot("create3"))
    """The robot."""
    lidar: LidarPreset = field(default_factory=lambda: load_lidar("rplidar_a2"))
    """The lidar. A period lasts as long as one scan, rounded to whole steps of motion; the number of beams is constant.
    """
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    """Errors of the wheel odometry."""
    lidar_layers: LidarLayers = field(default_factory=LidarLayers)
    """Imperfections of the lidar."""

    @property
    def steps(self) -> int:
        """Steps of motion in one period."""
        return max(1, round(STEP_RATE / self.lidar.scan_rate))

    @property
    def period(self) -> float:
        """Time between two commands, two odometry readings and two scans [s]."""
        return self.steps / STEP_RATE

    @property
    def limits(self) -> AccelerationLimits:
        """The robot's accelerations."""
        return AccelerationLimits(self.robot.max_acceleration, self.robot.max_turn_acceleration)

    @cached_property
    def steady_lidar(self) -> LidarPreset:
        """The lidar with a whole number of steps in a scan and a constant number of beams."""
        return self.lidar.model_copy(update={"scan_rate": 1.0 / self.period, "scan_times": None, "beam_jitter": 0.0})

    @cached_property
    def time_offsets(self) -> NDArray[np.float64]:
        """Time of each beam after the beginning of the period [s], (beams,)."""
        angles = self.steady_lidar.angles()
        offsets = (angles - angles[0]) / (2.0 * math.pi * self.steady_lidar.scan_rate)
        return offsets if self.lidar_layers.motion else np.zeros_like(offsets)


class Readings(NamedTuple):
    """Sensor readings and true poses at the end of a period; rows are robots."""

    ranges: NDArray[np.float64]
    """Ranges of the scan that began with the period [m], (robots, beams); inf = no return, -inf = too near, NaN = lost
    (REP 117)."""
    odometry: Pose
    """`T_odom_robot`, (robots, 3), headings not wrapped."""
    truth: Pose
    """`T_world_robot`, (robots, 3), headings not wrapped."""
    contact: NDArray[np.bool_]
    """Whether the robot touched a surface during the period, (robots,)."""


class Terrain:
    """A world without people and doors, prepared for the fast backend."""

    def __init__(self, world: World, lidar_height: float) -> None:
        self.world = world
        self.solid = segment_grid(world.boundary_segments())
        """Surfaces that stop bodies."""
        self.seen = segment_grid(world.boundary_segments(lidar_height, glass=False))
        """Surfaces that stop beams."""


class RobotGroup(Protocol):
    """Robots that move period by period."""

    def place(self, robot: int, terrain: Terrain, pose: Pose, seeds: RunSeeds) -> None:
        """Place the robot of that index at rest at `T_world_robot` (3,), with errors newly drawn from the seeds."""
        ...

    def step(self, targets: NDArray[np.float64], which: NDArray[np.intp] | None = None) -> Readings:
        """Steer robots towards speeds [m/s] and turn rates [rad/s], (robots, 2), for one period.

        which: indices of these robots, default: all; the rows of all others keep their last readings
        """
        ...

    def close(self) -> None:
        """Free all resources."""
        ...
