# SPDX-License-Identifier: MIT
"""Many robots on the fast backend, each in its own world, moved by one compiled call."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose
from testbed.seeds import RunSeeds
from testbed.simulation.fleet._fleet_kernels import Equipment, Numbers, Robots, SegmentGrids, Surroundings, step_robots
from testbed.simulation.fleet.robot_group import Readings, RobotSetup, Terrain
from testbed.simulation.physics._ray_kernels import SegmentGrid
from testbed.simulation.physics.backend import STEP_RATE
from testbed.simulation.physics.fast import vehicle_of
from testbed.simulation.robot._odometry_kernels import ODOMETER
from testbed.simulation.robot.lidar import BEAM_ROWS, draw_device, optics_of
from testbed.simulation.robot.odometry import READING_NORMALS, READING_UNIFORMS, believed_wheels, encoders_of
from testbed.simulation.robot.random_rows import RandomRows


class Fleet:
    """Robots on the fast backend.

    The motion and the readings of a robot depend on its own seed, world and commands only; they equal those of a fleet
    of one bit for bit.
    """

    def __init__(self, robots: int, setup: RobotSetup) -> None:
        self._setup = setup
        lidar, beams = setup.steady_lidar, setup.lidar.beams
        self._robots = Robots(
            np.zeros((robots, 7)), np.zeros((robots, ODOMETER)), np.ones((robots, 3)), np.zeros((robots, 5))
        )
        self._equipment = Equipment(
            vehicle=vehicle_of(setup.robot, setup.limits),
            encoders=encoders_of(setup.robot, setup.odometry),
            optics=optics_of(lidar, setup.lidar_layers),
            angles=lidar.angles(),
            angle_noise=math.radians(lidar.angle_noise_deg) * setup.lidar_layers.angle_noise,
            positions=setup.time_offsets * STEP_RATE,
            step_time=1.0 / STEP_RATE,
            steps=setup.steps,
        )
        self._readings = RandomRows(robots, READING_UNIFORMS, READING_NORMALS)
        self._beams = RandomRows(robots, 2 * beams, 2 * beams + 1, rows=BEAM_ROWS)
        self._terrains: list[Terrain | None] = [None] * robots
        self._surroundings: Surroundings | None = None
        self._contact = np.zeros(robots, np.bool_)
        self._ranges = np.full((robots, beams), np.nan)

    def place(self, robot: int, terrain: Terrain, pose: Pose, seeds: RunSeeds) -> None:
        """Place one robot, see `RobotGroup.place`."""
        setup = self._setup
        self._robots.body[robot] = [*pose, 0.0, 0.0, 0.0, 0.0]
        self._robots.odometer[robot] = 0.0
        rng = np.random.default_rng(seeds.odometry)
        self._robots.believed[robot] = believed_wheels(setup.robot, setup.odometry, rng)
        self._readings.seed(robot, rng)
        rng = np.random.default_rng(seeds.lidar)
        self._robots.device[robot] = draw_device(setup.steady_lidar, setup.robot.lidar_mount, setup.lidar_layers, rng)
        self._beams.seed(robot, rng)
        if self._terrains[robot] is not terrain:
            self._terrains[robot] = terrain
            self._surroundings = None

    def step(self, targets: NDArray[np.float64], which: NDArray[np.intp] | None = None) -> Readings:
        """Move the robots, see `RobotGroup.step`."""
        moved = np.arange(len(self._terrains)) if which is None else which
        if self._surroundings is None:
            anywhere = next(terrain for terrain in self._terrains if terrain is not None)
            terrains = [terrain or anywhere for terrain in self._terrains]  # robots without a place do not move
            self._surroundings = Surroundings(
                _packed([terrain.solid for terrain in terrains]), _packed([terrain.seen for terrain in terrains])
            )
        self._readings.advance(moved)
        self._beams.advance(moved)
        numbers = Numbers(
            self._readings.uniform, self._readings.normal, self._readings.row,
            self._beams.uniform, self._beams.normal, self._beams.row,
        )  # fmt: skip
        step_robots(
            moved, targets, self._robots, self._equipment, numbers, self._surroundings, self._contact, self._ranges
        )
        return Readings(
            self._ranges.copy(),
            self._robots.odometer[:, :3].copy(),
            self._robots.body[:, :3].copy(),
            self._contact.copy(),
        )

    def close(self) -> None:
        """Do nothing, because there is nothing to free."""


def _packed(grids: list[SegmentGrid]) -> SegmentGrids:
    """Return the grids of all robots; equal ones are stored once."""
    distinct = list({id(grid): grid for grid in grids}.values())
    counts = np.array([[len(g.first), len(g.segments)] for g in distinct])
    begins = np.cumsum(counts, axis=0) - counts
    number = {id(grid): k for k, grid in enumerate(distinct)}
    return SegmentGrids(
        segments=np.concatenate([g.segments for g in distinct]),
        first=np.concatenate([g.first + begins[k, 1] for k, g in enumerate(distinct)]),
        begin=np.array([begins[number[id(grid)], 0] for grid in grids]),
        shape=np.array([grid.shape for grid in grids]),
        origin=np.array([grid.origin for grid in grids]),
        cell=distinct[0].cell,
    )
