# SPDX-License-Identifier: MIT
"""A robot with wheels and a lidar drives the tour of a world: an iterator of frames."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from slam.scan import Scan
from slam.se2 import Pose
from testbed.frame import Frame
from testbed.presets import LidarPreset, RobotPreset, load_lidar, load_robot
from testbed.seeds import RunSeeds, Stream, children
from testbed.simulation.drivers.driver import Driver, DriverConfig
from testbed.simulation.drivers.tour import TourDriver
from testbed.simulation.history import History
from testbed.simulation.movers.movers import Movers
from testbed.simulation.physics.backend import STEP_RATE, Backend, Limits
from testbed.simulation.robot._lidar_kernels import place_beams
from testbed.simulation.robot.lidar import Lidar, LidarLayers
from testbed.simulation.robot.odometry import Odometry, OdometryConfig
from worlds import World, WorldError, check_world

CONTROL_STEPS = 12
"""Steps of motion between two commands and two odometry readings (20 Hz)."""
CONTROL_PERIOD = CONTROL_STEPS / STEP_RATE
"""Time between two commands and two odometry readings [s]."""
_INSTANT = 1e-6
"""What a scan takes whose beams all go at once [s]."""
TOUR_CLEARANCE = 0.05
"""Room that a tour must leave beside the robot's footprint, since pure pursuit cuts corners [m]."""


@dataclass(frozen=True, kw_only=True)
class SimulationConfig:
    """Everything about a simulation but the world."""

    robot: RobotPreset = field(default_factory=lambda: load_robot("create3"))
    """The robot."""
    lidar: LidarPreset = field(default_factory=lambda: load_lidar("rplidar_a2"))
    """The lidar."""
    further_lidars: tuple[LidarPreset, ...] = ()
    """More lidars, at the robot's `further_lidar_mounts`. Each scans on its own: their first beams are spread evenly
    over a scan's time."""
    driver: DriverConfig = field(default_factory=DriverConfig)
    """How the tour is driven."""
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    """Errors of the wheel odometry."""
    lidar_layers: LidarLayers = field(default_factory=LidarLayers)
    """Imperfections of the lidar."""
    backend: Literal["pybullet", "fast"] = "pybullet"
    """pybullet: physics and rays of PyBullet, the reference; fast: exact arcs and rays without physics."""
    duration: float = 1800.0
    """The simulation ends here at the latest [s]."""
    seeds: RunSeeds = field(default_factory=lambda: RunSeeds.from_seed(0))
    """All random numbers follow from them."""

    def __post_init__(self) -> None:
        if not self.duration > 0.0:
            raise ValueError(f"duration must be positive, got {self.duration} s")
        if len(self.further_lidars) > len(self.robot.further_lidar_mounts):
            raise ValueError(
                f"robot {self.robot.name!r} has room for {len(self.robot.lidar_mounts)} lidars, not for "
                f"{1 + len(self.further_lidars)}: expected further_lidar_mounts in its preset"
            )


class Simulation(Iterator[Frame]):
    """Frames of one drive, in the order of their stamps; made by `simulate`.

    Scans come at the lidar's rate, odometry-only frames in between (20 Hz). Use it as a context manager, or call
    `close`, where it is not read to its end.
    """

    def __init__(self, world: World, config: SimulationConfig, driver: Driver | None = None) -> None:
        """Raises `WorldError` if the robot does not fit through the world's tour, or if there is none to follow."""
        check_fits(world, config.robot)
        if driver is None and world.tour is None:
            raise WorldError(f"world {world.name!r} has no tour, expected [tour] with way points")
        self.world = world
        self.config = config
        self.driver = driver if driver is not None else TourDriver(world.path(), config.robot, config.driver)
        """Tells how the drive goes: `finished`, `stuck`, `recoveries`, `share`."""
        self.collided = False
        """The robot has touched something."""
        self._periods = 0
        self.movers = Movers(world, config.robot.footprint_radius, CONTROL_PERIOD, config.seeds.movers)
        """People and doors."""
        self._frames = self._run()

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._periods * CONTROL_PERIOD

    @property
    def finished(self) -> bool:
        """The drive has come to its end as planned."""
        return self.driver.finished

    @property
    def stuck(self) -> bool:
        """The drive was given up."""
        return self.driver.stuck

    def ended(self, duration: float | None) -> str | None:
        """Return why the drive did not end as planned, `collided` or `timeout`; None where it did.

        duration: the time after which a drive was meant to end [s]; None = at the end of its tour
        """
        if self.collided:
            return "collided"
        return None if self.finished or (duration is not None and not self.stuck) else "timeout"

    def __next__(self) -> Frame:
        return next(self._frames)

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the simulation and free the physics client; may be called twice."""
        self._frames.close()

    def _run(self) -> Generator[Frame, None, None]:
        config = self.config
        backend = _backend(self.world, config)
        try:
            sensors = _Sensors(backend, self.movers, config)
            while self.time < config.duration and not self.finished and not self.stuck:
                command = self._command(*sensors.truth.latest.tolist())
                motion = backend.drive(*command, CONTROL_STEPS)
                self.collided = self.collided or motion.contact
                self._periods += 1
                sensors.commands.append(command)
                sensors.truth.extend(motion.poses)
                sensors.read_wheels(*motion.wheels.tolist())
                self.movers.advance(*motion.poses[-1, :2].tolist())
                yield from sensors.frames_until(self.time)
            yield from sensors.odometry_frames(before=self.time)
        finally:
            backend.close()

    def _command(self, x: float, y: float, theta: float) -> tuple[float, float]:
        """What the driver wants, within the limits of the robot."""
        driver, robot = self.config.driver, self.config.robot
        if self.movers and self.movers.in_the_way(x, y, theta, 0.5 * driver.speed**2 / driver.acceleration):
            speed, turn_rate = self.driver.wait(self.time)
        else:
            speed, turn_rate = self.driver.command(self.time, x, y, theta)
        return _within(robot.max_speed, speed), _within(robot.max_turn_rate, turn_rate)


def simulate(world: World, config: SimulationConfig | None = None, driver: Driver | None = None) -> Simulation:
    """Drive through `world` and yield frames; by default TurtleBot 4's base with an RPLidar A2 in PyBullet.

    driver: who steers; None = along the tour of the world. Raises `WorldError` if the robot does not fit through the
    world's tour or there is none to follow, `PyBulletMissingError` where PyBullet is asked for but not installed.
    """
    return Simulation(world, config if config is not None else SimulationConfig(), driver)


def check_fits(world: World, robot: RobotPreset) -> None:
    """Raise `WorldError` unless the world is a sound place, and the robot has room at its start and along its tour."""
    check_world(world)
    try:
        check_world(world, footprint_radius=robot.footprint_radius + TOUR_CLEARANCE)
    except WorldError as error:
        raise WorldError(f"robot {robot.name!r} does not fit: {error}") from None


def _within(limit: float, value: float) -> float:
    return min(max(value, -limit), limit)


def _backend(world: World, config: SimulationConfig) -> Backend:
    limits = Limits(
        min(config.driver.acceleration, config.robot.max_acceleration),
        min(config.driver.turn_acceleration, config.robot.max_turn_acceleration),
    )
    if config.backend == "fast":
        from testbed.simulation.physics.fast import FastBackend

        return FastBackend(world, config.robot, limits)
    from testbed.simulation.physics.pybullet import PyBulletBackend

    return PyBulletBackend(world, config.robot, limits)


class _Device:
    """One lidar on the robot, and when it scans."""

    def __init__(self, number: int, config: SimulationConfig, stream: Stream) -> None:
        self.preset = (config.lidar, *config.further_lidars)[number]
        mount = config.robot.lidar_mounts[number]
        self.name, self.height = mount.name, mount.height
        self.lidar = Lidar(self.preset, mount, config.lidar_layers, np.random.default_rng(stream))
        self.sweep_time = self.preset.sweep_time if config.lidar_layers.motion else 0.0
        self._settled = max(self.sweep_time, _INSTANT)
        self._phase = number / (1 + len(config.further_lidars))
        self._scans = 0

    @property
    def stamp(self) -> float:
        """Of the next scan's first beam [s]."""
        return (self._scans + self._phase) / self.preset.scan_rate

    @property
    def complete(self) -> float:
        """When the next scan's last beam has been fired, and the command after its first one is known [s]."""
        return self.stamp + self._settled

    def advance(self) -> None:
        """The next scan has been taken."""
        self._scans += 1


def _devices(config: SimulationConfig) -> list[_Device]:
    """All lidars; the stream of the first does not depend on whether there are more."""
    streams = [config.seeds.lidar, *children(config.seeds.lidar, len(config.further_lidars))]
    return [_Device(number, config, stream) for number, stream in enumerate(streams)]


class _Sensors:
    """Truth in, frames out: keeps what the robot did until the scan that was being taken meanwhile is complete."""

    def __init__(self, backend: Backend, movers: Movers, config: SimulationConfig) -> None:
        self._backend, self._movers = backend, movers
        self._odometer = Odometry(config.robot, config.odometry, np.random.default_rng(config.seeds.odometry))
        self._devices = _devices(config)
        start = backend.drive(0.0, 0.0, 1)  # one step at rest tells where the robot stands
        self.truth = History(start.poses[-1], 1.0 / STEP_RATE)
        self._odometry = History(self._odometer.advance(*start.wheels.tolist()), CONTROL_PERIOD)
        self.commands: list[tuple[float, float]] = []
        """Speed [m/s] and turn rate [rad/s] commanded in each control period so far."""
        self._next_odometry = 0
        presets = [device.preset for device in self._devices]
        self._keep = max(p.sweep_time + 2.0 / p.scan_rate for p in presets) + 2.0 * CONTROL_PERIOD

    def read_wheels(self, left: float, right: float) -> None:
        """Take an odometry reading: angles turned by the wheels since the beginning [rad]."""
        self._odometry.extend(self._odometer.advance(left, right)[None])

    def frames_until(self, time: float) -> Iterator[Frame]:
        """Frames that are complete at `time` [s]: scans whose last beam was fired, and odometry up to then."""
        while (device := min(self._devices, key=lambda d: d.stamp)).complete <= time + 1e-9:
            stamp = device.stamp
            yield from self.odometry_frames(before=stamp)
            yield self._scan_frame(device)
            device.advance()
            if self._next_odometry * CONTROL_PERIOD < stamp + 1e-9:  # the scan's frame has told it
                self._next_odometry += 1
            for history in (self.truth, self._odometry, self._movers):
                history.forget_before(time - self._keep)

    def odometry_frames(self, before: float) -> Iterator[Frame]:
        """Frames without a scan that were not given yet, up to a time [s]."""
        while (stamp := self._next_odometry * CONTROL_PERIOD) < before - 1e-9:
            yield self._frame(stamp, CONTROL_PERIOD, None)
            self._next_odometry += 1

    def _scan_frame(self, device: _Device) -> Frame:
        stamp, lidar = device.stamp, device.lidar
        sweep = lidar.sweep()
        times = np.full(len(sweep.angles), stamp) if sweep.time_offsets is None else stamp + sweep.time_offsets
        origins, directions = place_beams(*self.truth.between(times), lidar.true_mount, sweep.true_angles)
        hits = self._backend.cast(origins, directions, device.preset.range_max, device.height)
        hits = self._movers.before(hits, origins, directions, times)
        scan = Scan(
            ranges=lidar.ranges(hits),
            angles=sweep.angles,
            range_min=device.preset.range_min,
            range_max=device.preset.range_max,
            stamp=stamp,
            mount=lidar.mount,
            time_offsets=sweep.time_offsets,
        )
        return self._frame(stamp, max(device.sweep_time, CONTROL_PERIOD), scan, lidar=device.name)

    def _frame(self, stamp: float, seconds: float, scan: Scan | None, lidar: str = Frame.lidar) -> Frame:
        """The frame of `stamp` [s], with the mean velocity by odometry over `seconds` from then on."""
        odometry = self._odometry.at(stamp)
        return Frame(
            stamp=stamp,
            odometry=_wrapped(odometry),
            scan=scan,
            lidar=lidar,
            twist=self._twist(stamp, odometry, seconds),
            command=self.commands[int((stamp + 1e-9) / CONTROL_PERIOD)],
            truth=_wrapped(self.truth.at(stamp)),
        )

    def _twist(self, stamp: float, odometry: tuple[float, float, float], seconds: float) -> Pose:
        """Mean velocity in the robot's frame over `seconds` from `stamp` on, or as far as odometry was read; over the
        last period read if there is none since."""
        end = min(stamp + seconds, self._odometry.end)
        if end - stamp < 0.5 * CONTROL_PERIOD:
            stamp = end - CONTROL_PERIOD
            odometry = self._odometry.at(stamp)
        x, y, theta = odometry
        x_end, y_end, theta_end = self._odometry.at(end)
        cos, sin, dx, dy, dt = math.cos(theta), math.sin(theta), x_end - x, y_end - y, end - stamp
        return np.array([(cos * dx + sin * dy) / dt, (-sin * dx + cos * dy) / dt, (theta_end - theta) / dt])


def _wrapped(pose: tuple[float, float, float]) -> Pose:
    return np.array([pose[0], pose[1], (pose[2] + math.pi) % (2.0 * math.pi) - math.pi])
