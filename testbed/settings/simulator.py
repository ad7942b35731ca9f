# SPDX-License-Identifier: MIT
"""Settings of the simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Group, Parameter

import worlds
from testbed.presets import LidarPreset, load_lidar, load_robot
from testbed.presets.models import MAX_BEAMS
from testbed.seeds import RunSeeds
from testbed.simulation import DriverConfig, LidarLayers, OdometryConfig, SimulationConfig, SurfaceConfig
from testbed.simulation.config import BackendName, decided_backend
from testbed.simulation.drivers.driver import Command, Strategy
from testbed.simulation.physics.pybullet import import_pybullet
from testbed.simulation.robot.off_wall import OffWallBeams
from testbed.simulation.simulator import TOUR_CLEARANCE
from worlds import World

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
    """fixed: every seed drives the tour of the world as it is; random: each seed drives the tour in another order, from
    another start; stops: each seed drives to different stops, about as far as the tour is long. Only for --driver
    tour."""
    start: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """Start as X,Y,DEG [m, deg] in the frame of the world or map; a tour is planned from there. Default: the start of
    the world."""
    clutter: float = 0.0
    """Objects added off the tour, per 10 m² of floor."""
    backend: BackendName = "auto"
    """pybullet: physics and rays of PyBullet; fast: exact arcs and rays without physics; auto: PyBullet where it is
    installed, else fast."""
    duration: float | None = None
    """Longest simulated time [s]; default: until the tour is finished."""
    driver: Annotated[DriverConfig, Parameter(group=SIMULATOR_GROUP)] = field(default_factory=DriverConfig)
    """The driver and its limits."""
    commands: Path | None = None
    """Commands for --driver recorded: a dataset, a log with /cmd_vel, or a CSV table `stamp,speed,turn_rate`."""
    off_wall: Path | None = None
    """What the lidar of a recorded drive saw that is no wall, for --driver recorded: a CSV table
    `stamp,x,y,direction,range`, as `testbed twin` writes it."""
    odometry: Annotated[OdometryConfig, Parameter(group=SIMULATOR_GROUP)] = field(default_factory=OdometryConfig)
    """Errors of the wheel odometry."""
    layers: Annotated[LidarLayers, Parameter(group=SIMULATOR_GROUP)] = field(default_factory=LidarLayers)
    """Imperfections of the lidar."""
    surface: Annotated[SurfaceConfig, Parameter(group=SIMULATOR_GROUP)] = field(default_factory=SurfaceConfig)
    """Roughness of what the lidars see."""

    def __post_init__(self) -> None:
        if (self.driver.kind == "recorded") != (self.commands is not None):
            raise ValueError("--driver recorded and --commands FILE belong together, expected both or none")
        if self.off_wall is not None and self.commands is None:
            raise ValueError(
                "--off-wall FILE is of a recorded drive, expected --driver recorded and --commands FILE, too"
            )
        if self.start is not None:
            self._check_start()
        if not self.noise >= 0.0:
            raise ValueError(f"noise must not be negative, got {self.noise}")
        if self.beams is not None and not 1 <= self.beams <= MAX_BEAMS:
            raise ValueError(f"beams must be 1 to {MAX_BEAMS}, got {self.beams}")

    def settled(self) -> SimulatorOptions:
        """Return the options with the backend decided, as `config.toml` holds them."""
        return replace(self, backend=decided_backend(self.backend))

    def simulation(self, seeds: RunSeeds) -> SimulationConfig:
        """Return the settings of the simulator. Raises ValueError where the backend is not installed."""
        if decided_backend(self.backend) == "pybullet":
            import_pybullet()
        lidar, *further = (self._changed(load_lidar(name)) for name in self.lidars)
        return SimulationConfig(
            robot=load_robot(self.robot),
            lidar=lidar,
            further_lidars=tuple(further),
            driver=self.driver,
            odometry=self.odometry,
            lidar_layers=self.layers,
            surface=self.surface,
            off_wall=self._recorded_off_wall(),
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
        clearance = load_robot(self.robot).footprint_radius + TOUR_CLEARANCE
        # A recorded drive begins where the drive began that its commands are from.
        on_tour = self.driver.kind == "tour" or (self.driver.kind == "recorded" and self.route != "fixed")
        world = self._world_with_tour(name, clearance if on_tour else None, progress)
        if (
            self.route == "stops" and on_tour
        ):  # before the clutter, which keeps off this drive: it does not change the path
            rng = np.random.default_rng(seeds.route)
            world = worlds.stops_route(world, rng, clearance=clearance, keep_start=self.start is not None)
        if self.clutter:
            world = worlds.add_clutter(world, self.clutter, clearance=clearance + CLUTTER_CLEARANCE)
        if self.route == "random" and on_tour:
            world = worlds.random_route(world, np.random.default_rng(seeds.route))
        return world

    def _check_start(self) -> None:
        """Raise ValueError for a start that is not X,Y,DEG, or that a route would not begin at."""
        from testbed.estimation.known_map import parse_start  # here: it brings the localisation along

        parse_start(self.start or "")
        if self.route == "random":
            raise ValueError(f"--start {self.start}: --route random begins elsewhere, expected fixed or stops")

    def _world_with_tour(self, name: str, clearance: float | None, progress: Callable[[float], None] | None) -> World:
        """Return the world of that name with its start and, unless `clearance` is None, with a tour.

        The last one is kept: reading a map and planning a tour take seconds, and a job makes many drives in one world.
        """
        files = [Path(name)] if worlds.is_map(name) or name.endswith(".toml") else []
        files += [worlds.map_image(file) for file in files if worlds.is_map(file) and file.is_file()]
        changed = tuple(file.stat().st_mtime_ns for file in files if file.is_file())
        key = (name, changed, self.robot, self.start, clearance)
        if key not in _KEPT:
            world = worlds.load(name)
            if self.start is not None:
                world = self._from_start(world)
            if world.tour is None and clearance is not None:
                world = worlds.plan_tour(world, footprint_radius=clearance, progress=progress)
            _KEPT.clear()
            _KEPT[key] = world
        return _KEPT[key]

    def _from_start(self, world: World) -> World:
        """Return the world with its start at `start` and without a tour, which began elsewhere.

        Raises WorldError where the place is not free.
        """
        from testbed.estimation.known_map import parse_start

        x, y, theta = parse_start(self.start or "")
        start = worlds.Start(x=x - world.offset[0], y=y - world.offset[1], theta=theta)
        moved = world.model_copy(update={"start": start, "tour": None, "difficulty": None})
        worlds.check_world(moved, footprint_radius=load_robot(self.robot).footprint_radius)
        return moved

    def recorded_commands(self) -> list[Command] | None:
        """Return the commands of `commands`; None if no file is given."""
        if self.commands is None:
            return None
        from testbed.formats.commands import read_commands  # here: it needs the readers of all formats

        return read_commands(self.commands)

    def _recorded_off_wall(self) -> OffWallBeams | None:
        """Return the beams of `off_wall`; None if no file is given."""
        if self.off_wall is None:
            return None
        from testbed.formats.off_wall import read_off_wall

        return read_off_wall(self.off_wall)

    def files(self, world: str) -> list[Path]:
        """Return the user's files among world, robot, lidars and what was recorded, with the image of a ROS map."""
        names = (world, self.robot, *self.lidars, self.commands, self.off_wall)
        named = [Path(name) for name in names if name is not None]
        files = [path for path in named if path.is_file()]
        return files + [worlds.map_image(path) for path in files[:1] if path == Path(world) and worlds.is_map(path)]


_KEPT: dict[tuple[object, ...], World] = {}
"""The last world that was loaded, by what it was made of."""

SIMULATOR = SimulatorOptions()


@dataclass(frozen=True, kw_only=True)
class DatasetDriverConfig(DriverConfig):
    """The driver of a dataset, which needs neither a mapper nor a person; `testbed simulate` says so of the others."""

    kind: Annotated[Literal["tour", "explore", "recorded", "teleop"], Parameter(show_choices=False)] = "tour"
    """tour: follow the tour of the world; recorded: repeat the commands of --commands."""
    strategy: Annotated[Strategy, Parameter(show=False)] = DriverConfig.strategy
    """Of explore, which makes no datasets."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class FastSimulatorOptions(SimulatorOptions):
    """The simulated robot and its sensors; the fast backend and random routes by default."""

    driver: Annotated[DatasetDriverConfig, Parameter(group=SIMULATOR_GROUP)] = field(
        default_factory=DatasetDriverConfig
    )
    """The driver and its limits."""
    backend: BackendName = "fast"
    """pybullet: physics and rays of PyBullet; fast: exact arcs and rays without physics; auto: PyBullet where it is
    installed, else fast."""
    route: Route | None = None  # type: ignore[assignment]  # settled before use
    """stops: each seed drives to different stops, about as far as the tour is long; random: each seed drives the tour
    in another order, from another start; fixed: every seed drives the tour as it is. Default: stops, but fixed with
    --driver recorded."""

    def settled(self) -> FastSimulatorOptions:
        """Return the options with backend and route decided."""
        route = self.route or ("stops" if self.driver.kind == "tour" else "fixed")
        return replace(self, backend=decided_backend(self.backend), route=route)


FAST_SIMULATOR = FastSimulatorOptions()
