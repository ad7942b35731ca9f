# SPDX-License-Identifier: MIT
"""A group of one robot on any backend, such as PyBullet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose
from testbed.presets import RobotPreset
from testbed.seeds import RunSeeds
from testbed.simulation.fleet.robot_group import Readings, RobotSetup, Terrain
from testbed.simulation.physics.backend import STEP_RATE, AccelerationLimits, Backend
from testbed.simulation.robot._lidar_kernels import place_beams
from testbed.simulation.robot.lidar import Lidar
from testbed.simulation.robot.odometry import Odometry
from worlds import Start, World

MakeBackend = Callable[[World, RobotPreset, AccelerationLimits], Backend]


class BackendRobot:
    """One robot with its sensors; on the fast backend it gives the same bits as a `Fleet` of one."""

    def __init__(self, setup: RobotSetup, make_backend: MakeBackend) -> None:
        """make_backend: makes the backend, such as the class `PyBulletBackend`."""
        self._setup, self._make = setup, make_backend
        self._backend: Backend | None = None

    def place(self, robot: int, terrain: Terrain, pose: Pose, seeds: RunSeeds) -> None:
        """Place the robot, see `RobotGroup.place`."""
        if robot != 0:
            raise IndexError(f"robot must be 0, got {robot}")
        self.close()
        setup = self._setup
        x, y, theta = (float(value) for value in pose)
        world = terrain.world.model_copy(update={"start": Start(x=x, y=y, theta=theta)})
        self._backend = self._make(world, setup.robot, setup.limits)
        self._odometry = Odometry(setup.robot, setup.odometry, np.random.default_rng(seeds.odometry))
        rng = np.random.default_rng(seeds.lidar)
        self._lidar = Lidar(setup.steady_lidar, setup.robot.lidar_mount, setup.lidar_layers, rng)
        self._pose = np.array(pose, dtype=np.float64)

    def step(self, targets: NDArray[np.float64], which: NDArray[np.intp] | None = None) -> Readings:
        """Move the robot, see `RobotGroup.step`."""
        assert self._backend is not None
        speed, turn_rate = targets[0].tolist()
        motion = self._backend.drive(speed, turn_rate, self._setup.steps)
        poses = np.concatenate([self._pose[None], motion.poses])
        poses[:, 2] = np.unwrap(poses[:, 2])
        self._pose = poses[-1]
        odometry = self._odometry.advance(*motion.wheels.tolist())
        sweep = self._lidar.sweep()
        origins, directions = place_beams(
            poses, self._setup.time_offsets * STEP_RATE, self._lidar.true_mount, sweep.true_angles
        )
        height = self._setup.robot.lidar_mount.height
        hits = self._backend.cast(origins, directions, self._setup.lidar.range_max, height)
        ranges = self._lidar.ranges(hits)
        return Readings(ranges[None], odometry[None], self._pose[None].copy(), np.array([motion.contact]))

    def close(self) -> None:
        """Free the physics client; may be called twice."""
        if self._backend is not None:
            self._backend.close()
            self._backend = None
