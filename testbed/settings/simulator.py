# SPDX-License-Identifier: MIT
"""Settings of the simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Group, Parameter

from testbed.formats.commands import read_commands
from testbed.presets import LidarPreset, load_lidar, load_robot
from testbed.presets.models import MAX_BEAMS
from testbed.seeds import RunSeeds
from testbed.simulation import DriverConfig, LidarLayers, OdometryConfig, SimulationConfig
from testbed.simulation.drivers.driver import Command
from testbed.simulation.physics.pybullet import import_pybullet
from testbed.simulation.simulator import TOUR_CLEARANCE
from worlds import World, add_clutter, is_map, load, map_image, plan_tour, random_route, stops_route

SIMULATOR_GROUP = Group("Simulator", sort_key=5)
DEFAULT = SimulationConfig()
CLUTTER_CLEARANCE = 0.1
"""Additional distance between the robot and the objects of --clutter [m]."""
Route = Literal["fixed", "random", "stops"]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SimulatorOptions:
    """The simulated robot and its sensors."""

    robot: str = DEFAULT.robot.name
    """Name of a robot preset, or a TOML file."""
    lidar: str = DEFAULT.lidar.name
    """Name of a lidar preset, or a TOML file; several are separated by commas, if the robot has mounts for them."""
    beams: int | None = None
    """Beams in a scan; default: those of the lidar."""
    noise: float = 1.0
    """Factor on the random error of ranges."""
    route: Route = "fixed"
    """fixed: the tour of the world, the same for every seed; random: the whole tour in another order and direction from
    another start, drawn from the seed; stops: to random stops on all floor, drawn from the seed, as far as the tour is
    long. Only for --driver tour."""
    clutter: float = 0.0
    """Objects added off the tour, per 10 m² of floor."""
    backend: Literal["pybullet", "fast"] = "pybullet"
    """pybullet: physics and rays of PyBullet; fast: exact arcs and rays without physics."""
    duration: float | None = None
    """Longest simulated time [s]; default: until the tour is finished."""
    driver: Annotated[DriverConfig, Parameter(group=SIMULATOR_GROUP)] = field(default_factory=DriverConfig)
    """The driver and its limits."""
    commands: Path | None = None
    """Commands for --driver recorded: a dataset, a log with /cmd_vel, or a CSV table `stamp,speed,turn_rate`."""
    odometry: Annotated[OdometryConfig, Parameter(group=SIMULATOR_GROUP)] = field(default_factory=OdometryConfig)
    """Errors of the wheel odometry."""
    layers: Annotated[LidarLayers, Parameter(group=SIMULATOR_GROUP)] = field(default_factory=LidarLayers)
    """Imperfections of the lidar."""

    def __post_init__(self) -> None:
        if (self.driver.kind == "recorded") != (self.commands is not None):
            raise ValueError("--driver recorded and --commands FILE belong together, expected both or none")
        if not self.noise >= 0.0:
            raise ValueError(f"noise must not be negative, got {self.noise}")
        if self.beams is not None and not 1 <= self.beams <= MAX_BEAMS:
            raise ValueError(f"beams must be 1 to {MAX_BEAMS}, got {self.beams}")

    def simulation(self, seeds: RunSeeds) -> SimulationConfig:
        """Return the settings of the simulator. Raises ValueError where the backend is not installed."""
        if self.backend == "pybullet":
            import_pybullet()
        lidar, *further = (self._changed(load_lidar(name)) for name in self.lidars)
        return SimulationConfig(
            robot=load_robot(self.robot),
            lidar=lidar,
            further_lidars=tuple(further),
            driver=self.driver,
            odometry=self.odometry,
            lidar_layers=self.layers,
            backend=self.backend,
            duration=DEFAULT.duration if self.duration is None else self.duration,
            seeds=seeds,
        )

    @property
    def lidars(self) -> list[str]:
        """Names or files of the lidars; the first is the main one."""
        return [name.strip() for name in self.lidar.split(",")]

    def _changed(self, lidar: LidarPreset) -> LidarPreset:
        """Return the lidar with `beams` and `noise` applied."""
        return lidar.model_copy(
            update={
                "beams": lidar.beams if self.beams is None else self.beams,
                "noise_floor": self.noise * lidar.noise_floor,
                "noise_share": self.noise * lidar.noise_share,
            }
        )

    def load_world(self, name: str, seeds: RunSeeds, progress: Callable[[float], None] | None = None) -> World:
        """Load the world of that name or file, with --clutter added and, unless --route fixed, a route of the seed.

        Where a tour is to be driven and the world has none, it gets a tour of all the floor that the robot can reach.
        progress: called with the share of the tour that is planned, 0 to 1.
        """
        world, clearance = _load(name), load_robot(self.robot).footprint_radius + TOUR_CLEARANCE
        # A recorded drive begins where the drive began that its commands are from.
        on_tour = self.driver.kind == "tour" or (self.driver.kind == "recorded" and self.route != "fixed")
        if world.tour is None and on_tour:
            world = plan_tour(world, footprint_radius=clearance, progress=progress)
        if (
            self.route == "stops" and on_tour
        ):  # before the clutter, which keeps off this drive: it does not change the path
            world = stops_route(world, np.random.default_rng(seeds.route), clearance=clearance)
        if self.clutter:
            world = add_clutter(world, self.clutter, clearance=clearance + CLUTTER_CLEARANCE)
        if self.route == "random" and on_tour:
            world = random_route(world, np.random.default_rng(seeds.route))
        return world

    def recorded_commands(self) -> list[Command] | None:
        """Return the commands of `commands`; None if no file is given."""
        return None if self.commands is None else read_commands(self.commands)

    def files(self, world: str) -> list[Path]:
        """Return the user's files among world, robot, lidars and commands, with the image of a ROS map."""
        named = [Path(name) for name in (world, self.robot, *self.lidars, self.commands) if name is not None]
        files = [path for path in named if path.is_file()]
        return files + [map_image(path) for path in files[:1] if path == Path(world) and is_map(path)]


def _load(name: str) -> World:
    """Load a world; those without a file of the user cannot change, so that the last one is kept."""
    return load(name) if is_map(name) or name.endswith(".toml") else _load_named(name)


@lru_cache(maxsize=1)
def _load_named(name: str) -> World:
    return load(name)


SIMULATOR = SimulatorOptions()


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FastSimulatorOptions(SimulatorOptions):
    """The simulated robot and its sensors; the fast backend and random routes by default."""

    backend: Literal["pybullet", "fast"] = "fast"
    """pybullet: physics and rays of PyBullet; fast: exact arcs and rays without physics."""
    route: Route | None = None  # type: ignore[assignment]  # settled before use
    """stops: to random stops on all floor, others for each seed, as far as the tour is long; random: the whole
    tour in another order and direction from another start for each seed; fixed: the tour of the world, the same for
    every seed. Default: stops for --driver tour, otherwise fixed."""

    def settled(self) -> FastSimulatorOptions:
        """Return the options with the route decided."""
        if self.route is not None:
            return self
        return replace(self, route="stops" if self.driver.kind == "tour" else "fixed")


FAST_SIMULATOR = FastSimulatorOptions()
