# SPDX-License-Identifier: MIT
"""A drive of a simulated robot through a world, as an iterator of frames."""

from __future__ import annotations

from collections.abc import Generator, Iterator

from testbed.frame import Frame
from testbed.frame_table import FrameTable
from testbed.presets import RobotPreset
from testbed.simulation.config import CONTROL_PERIOD, CONTROL_STEPS, SimulationConfig
from testbed.simulation.drivers.driver import Driver
from testbed.simulation.drivers.recorded import RecordedDriver
from testbed.simulation.drivers.tour import TourDriver
from testbed.simulation.movers.movers import Movers
from testbed.simulation.physics.backend import AccelerationLimits, Backend
from testbed.simulation.physics.fast import FastBackend
from testbed.simulation.sensors import Sensors
from worlds import World, WorldError, check_world

TOUR_CLEARANCE = 0.05
"""Least distance between a tour and walls in addition to the footprint, since pure pursuit cuts corners [m]."""


FRAMES_AHEAD = 16
"""Frames that are made together where the driver does not depend on who reads the frames: some 0.8 s of a drive."""
PERIODS_AHEAD = 16
"""Most control periods that are driven by one call."""


class Simulation(Iterator[Frame]):
    """Frames of one drive in the order of their stamps, made by `simulate`.

    Scans come at the lidar's rate, odometry-only frames in between (20 Hz). Use it as a context manager, or call
    `close` if it is not read to its end.
    """

    def __init__(self, world: World, config: SimulationConfig, driver: Driver | None = None) -> None:
        """Raise `WorldError` if the robot does not fit through the world's tour, or if there is no tour to follow."""
        check_fits(world, config.robot)
        if driver is None and world.tour is None:
            raise WorldError(f"world {world.name!r} has no tour, expected [tour] with way points")
        self.world = world
        self.config = config
        self.driver = driver if driver is not None else TourDriver(world.path(), config.robot, config.driver)
        """The driver, which knows the progress: `finished`, `stuck`, `recoveries`, `share`."""
        self.collided = False
        """Whether the robot has touched something."""
        self._periods = 0
        self.movers = Movers(world, config.robot.footprint_radius, CONTROL_PERIOD, config.seeds.movers)
        """People and doors."""
        self._blocks = self._drive(FRAMES_AHEAD if isinstance(self.driver, TourDriver | RecordedDriver) else 1)
        self._frames: Iterator[Frame] = iter(())  # of the current block

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._periods * CONTROL_PERIOD

    @property
    def finished(self) -> bool:
        """Whether the drive has ended as planned."""
        return self.driver.finished

    @property
    def stuck(self) -> bool:
        """Whether the drive was given up."""
        return self.driver.stuck

    def ended(self, duration: float | None) -> str | None:
        """Return why the drive did not end as planned, `collided` or `timeout`; None where it did.

        duration: the time after which a drive was meant to end [s]; None = at the end of its tour
        """
        if self.collided:
            return "collided"
        return None if self.finished or (duration is not None and not self.stuck) else "timeout"

    def __next__(self) -> Frame:
        while (frame := next(self._frames, None)) is None:
            self._frames = iter(next(self._blocks).frames())
        return frame

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the simulation and free the physics client; may be called twice."""
        self._blocks.close()
        self._frames = iter(())

    def blocks(self, size: int) -> Iterator[FrameTable]:
        """Return all frames, `size` at a time: faster than one by one, and the same to the last bit.

        Use it instead of the iteration over frames. The drive is ahead of the last frame by up to a block.
        """
        self._blocks = self._drive(size)
        return self._blocks

    def _drive(self, size: int) -> Generator[FrameTable, None, None]:
        backend = _backend(self.world, self.config)
        first = 0
        try:
            sensors = Sensors(backend, self.movers, self.config)
            while self.time < self.config.duration and not self.finished and not self.stuck:
                self._drive_on(backend, sensors)
                while sensors.due >= size:
                    yield sensors.take(size, first)
                    first += size
            sensors.await_rest(self._periods)
            while sensors.due:
                yield sensors.take(size, first)
                first += size
        finally:
            backend.close()

    def _drive_on(self, backend: Backend, sensors: Sensors) -> None:
        """Drive a control period, or several where nobody interferes."""
        first = self._periods
        if isinstance(backend, FastBackend) and isinstance(self.driver, TourDriver) and not self.movers:
            further = range(1, PERIODS_AHEAD)
            left = next((k for k in further if (first + k) * CONTROL_PERIOD >= self.config.duration), PERIODS_AHEAD)
            driven, contact = sensors.drive_tour(backend, self.driver, first, left)
            self.collided = self.collided or contact
            self._periods += driven
        else:
            self._drive_a_period(backend, sensors)
        sensors.await_frames(first + 1, self._periods)

    def _drive_a_period(self, backend: Backend, sensors: Sensors) -> None:
        command = self._command(*sensors.truth.latest.tolist())
        motion = backend.drive(*command, CONTROL_STEPS)
        self.collided = self.collided or motion.contact
        self._periods += 1
        sensors.record(command, motion)
        self.movers.advance(*motion.poses[-1, :2].tolist())

    def _command(self, x: float, y: float, theta: float) -> tuple[float, float]:
        """Return the driver's command, clipped to the limits of the robot."""
        driver, robot = self.config.driver, self.config.robot
        if self.movers and self.movers.in_the_way(x, y, theta, 0.5 * driver.speed**2 / driver.acceleration):
            speed, turn_rate = self.driver.wait(self.time)
        else:
            speed, turn_rate = self.driver.command(self.time, x, y, theta)
        return _within(robot.max_speed, speed), _within(robot.max_turn_rate, turn_rate)


def simulate(world: World, config: SimulationConfig | None = None, driver: Driver | None = None) -> Simulation:
    """Return the frames of a drive; the default is a TurtleBot 4 base with an RPLidar A2, by PyBullet where installed.

    driver: steers the robot; None = along the tour of the world. Raises `WorldError` if the robot does not fit through
    the tour or there is none, and `PyBulletMissingError` if the backend is `pybullet` and PyBullet is not installed.
    """
    return Simulation(world, config if config is not None else SimulationConfig(), driver)


def check_fits(world: World, robot: RobotPreset) -> None:
    """Raise `WorldError` unless the world is valid and has room for the robot at its start and along its tour."""
    try:
        check_world(world, footprint_radius=robot.footprint_radius + TOUR_CLEARANCE)
    except WorldError as error:
        check_world(world)  # whatever the robot
        raise WorldError(f"robot {robot.name!r} does not fit: {error}") from None


def _within(limit: float, value: float) -> float:
    return min(max(value, -limit), limit)


def _backend(world: World, config: SimulationConfig) -> Backend:
    limits = AccelerationLimits(
        min(config.driver.acceleration, config.robot.max_acceleration),
        min(config.driver.turn_acceleration, config.robot.max_turn_acceleration),
    )
    if config.backend == "fast":
        return FastBackend(world, config.robot, limits)
    from testbed.simulation.physics.pybullet import PyBulletBackend

    return PyBulletBackend(world, config.robot, limits)
