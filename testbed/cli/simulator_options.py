# SPDX-License-Identifier: MIT
"""Options that `run` and `simulate` share."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Group, Parameter

from testbed.presets import load_lidar, load_robot
from testbed.simulation import DriverConfig, LidarLayers, OdometryConfig, SimulationConfig
from testbed.simulation.pybullet_backend import import_pybullet
from testbed.simulation.simulator import TOUR_CLEARANCE
from worlds import World, load, plan_tour

SIMULATOR_GROUP = Group("Simulator", sort_key=5)
DEFAULT = SimulationConfig()


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SimulatorOptions:
    """The simulated robot and its sensors."""

    robot: str = DEFAULT.robot.name
    """Name of a robot, or a TOML file."""
    lidar: str = DEFAULT.lidar.name
    """Name of a lidar, or a TOML file; several, separated by commas, for robots with room for them."""
    backend: Literal["pybullet", "fast"] = "pybullet"
    """pybullet: physics and rays of PyBullet; fast: exact arcs and a ray caster of ours."""
    duration: float | None = None
    """Longest simulated time [s]; default: until the tour is finished."""
    driver: Annotated[DriverConfig, Parameter(group=SIMULATOR_GROUP)] = field(default_factory=DriverConfig)
    """How the tour is driven."""
    odometry: Annotated[OdometryConfig, Parameter(group=SIMULATOR_GROUP)] = field(default_factory=OdometryConfig)
    """Errors of the wheel odometry."""
    layers: Annotated[LidarLayers, Parameter(group=SIMULATOR_GROUP)] = field(default_factory=LidarLayers)
    """Imperfections of the lidar."""

    def simulation(self, seed: int) -> SimulationConfig:
        """Settings of the simulator; ValueError where the backend is not installed."""
        if self.backend == "pybullet":
            import_pybullet()
        lidar, *further = map(load_lidar, self.lidars)
        return SimulationConfig(
            robot=load_robot(self.robot),
            lidar=lidar,
            further_lidars=tuple(further),
            driver=self.driver,
            odometry=self.odometry,
            lidar_layers=self.layers,
            backend=self.backend,
            duration=DEFAULT.duration if self.duration is None else self.duration,
            seed=seed,
        )

    @property
    def lidars(self) -> list[str]:
        """Names or files of the lidars, the main one first."""
        return [name.strip() for name in self.lidar.split(",")]

    def place(self, world: str) -> World:
        """The world of that name or file; one without a tour gets a tour of all the floor that the robot can reach."""
        place = load(world)
        if place.tour is not None:
            return place
        return plan_tour(place, footprint_radius=load_robot(self.robot).footprint_radius + TOUR_CLEARANCE)

    def files(self, world: str) -> list[Path]:
        """Which of world, robot and lidars are files of the user's own."""
        return [path for path in map(Path, (world, self.robot, *self.lidars)) if path.is_file()]


SIMULATOR = SimulatorOptions()
