# SPDX-License-Identifier: MIT
"""Keyword arguments of `gymnasium.make` that all environments share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from testbed.envs.scenario.generated_worlds import GeneratedWorlds
from testbed.envs.scenario.scenario import Scenario, Start
from testbed.presets import LidarPreset, RobotPreset, load_lidar, load_robot
from testbed.simulation.fleet.fleet import Fleet
from testbed.simulation.fleet.robot_group import RobotGroup, RobotSetup
from testbed.simulation.fleet.single_robot import BackendRobot
from testbed.simulation.robot.lidar import LidarLayers
from testbed.simulation.robot.odometry import OdometryConfig
from worlds import World

MAX_BEAMS = 10_000
"""Largest number of beams of an observation."""


def check_type(name: str, value: object, types: tuple[type, ...], expected: str) -> None:
    """Raise ValueError, which names the argument and what was expected, for a value of another type."""
    if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
        raise ValueError(f"{name} must be {expected}, got {str(value)[:100]!r} of type {type(value).__name__}")


@dataclass(frozen=True, kw_only=True)
class EnvironmentSettings:
    """Keyword arguments that all environments take."""

    world: str | World | GeneratedWorlds = "office"
    """Name from the catalogue, file, a world, or generated worlds."""
    start: Start = "random"
    """Start of the episodes: anywhere with room for the robot, or at the world's own start."""
    robot: str | RobotPreset = "create3"
    """Preset by name, file or value."""
    lidar: str | LidarPreset = "rplidar_a2"
    """Preset by name, file or value."""
    beams: int | None = 180
    """Beams of the lidar; None = those of the preset."""
    odometry: OdometryConfig | None = None
    """Errors of the wheel odometry; None = typical ones."""
    lidar_layers: LidarLayers | None = None
    """Imperfections of the lidar; None = all of them."""
    backend: Literal["fast", "pybullet"] = "fast"
    """fast: exact arcs and rays; pybullet: physics, for single environments."""

    def __post_init__(self) -> None:
        check_type("world", self.world, (str, World, GeneratedWorlds), "a name, a file, a World or GeneratedWorlds")
        check_type("robot", self.robot, (str, RobotPreset), "a name, a file or a RobotPreset")
        check_type("lidar", self.lidar, (str, LidarPreset), "a name, a file or a LidarPreset")
        check_type("beams", self.beams, (int, np.integer, type(None)), f"a whole number from 1 to {MAX_BEAMS}, or None")
        check_type("odometry", self.odometry, (OdometryConfig, type(None)), "an OdometryConfig or None")
        check_type("lidar_layers", self.lidar_layers, (LidarLayers, type(None)), "LidarLayers or None")

    def robot_setup(self) -> RobotSetup:
        """Return the robot and its sensors."""
        lidar = load_lidar(self.lidar) if isinstance(self.lidar, str) else self.lidar
        if self.beams is not None:
            if not 1 <= self.beams <= MAX_BEAMS:
                raise ValueError(f"beams must be 1 to {MAX_BEAMS}, got {self.beams}")
            lidar = lidar.model_copy(update={"beams": int(self.beams)})
        return RobotSetup(
            robot=load_robot(self.robot) if isinstance(self.robot, str) else self.robot,
            lidar=lidar,
            odometry=self.odometry or OdometryConfig(),
            lidar_layers=self.lidar_layers or LidarLayers(),
        )

    def scenario(self, setup: RobotSetup) -> Scenario:
        """Return the worlds and start poses of the episodes."""
        return Scenario(self.world, self.start, setup.robot)

    def group(self, robots: int, setup: RobotSetup) -> RobotGroup:
        """Return robots on the backend. Raises `PyBulletMissingError` where PyBullet is asked for but not installed."""
        if self.backend == "fast":
            return Fleet(robots, setup)
        if self.backend != "pybullet":
            raise ValueError(f"backend must be 'fast' or 'pybullet', got {self.backend!r}")
        if robots != 1:
            raise ValueError(f"{robots} robots in one process need the fast backend; PyBullet's go into AsyncVectorEnv")
        from testbed.simulation.physics.pybullet import PyBulletBackend, import_pybullet

        import_pybullet()
        return BackendRobot(setup, PyBulletBackend)
