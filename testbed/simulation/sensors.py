# SPDX-License-Identifier: MIT
"""The sensors of one simulated robot: true motion in, frames out."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose, wrap_angle
from testbed.frame_table import BeamPattern, FrameTable
from testbed.seeds import Stream, children
from testbed.simulation._tour_kernels import Drive, drive_tour
from testbed.simulation.config import CONTROL_PERIOD, CONTROL_STEPS, SimulationConfig
from testbed.simulation.drivers.tour import TourDriver
from testbed.simulation.history import History
from testbed.simulation.movers.movers import Movers
from testbed.simulation.physics.backend import STEP_RATE, Backend, Hits, Motion
from testbed.simulation.physics.fast import FastBackend
from testbed.simulation.robot._lidar_kernels import place_beams
from testbed.simulation.robot.lidar import Lidar
from testbed.simulation.robot.odometry import Odometry
from testbed.simulation.robot.off_wall import OffWallBeams
from testbed.simulation.robot.surface import Surface

_INSTANT = 1e-6
"""Duration of a scan whose beams are all fired at once [s]."""


class Device:
    """One lidar on the robot and the times of its scans."""

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
        """Time of the first beam of the next scan [s]; inf where there is none."""
        if (times := self.preset.scan_times) is not None:
            return times[self._scans] if self._scans < len(times) else math.inf
        return (self._scans + self._phase) / self.preset.scan_rate

    @property
    def complete(self) -> float:
        """Time at which the next scan is complete: its last beam was fired, and the command after its first is known
        [s]."""
        return self.stamp + self._settled

    def advance(self) -> None:
        """Go on to the next scan."""
        self._scans += 1


def _devices(config: SimulationConfig) -> list[Device]:
    """Return all lidars; the stream of the first does not depend on the others."""
    streams = [config.seeds.lidar, *children(config.seeds.lidar, len(config.further_lidars))]
    return [Device(number, config, stream) for number, stream in enumerate(streams)]


class _Due(NamedTuple):
    """A frame whose content is known, since the robot has driven long enough."""

    stamp: float
    """Its time [s]."""
    device: Device | None
    """The lidar of its scan; None = it has none."""
    periods: int
    """Control periods after which it was complete: it is made of what was known then."""


class Sensors:
    """Makes frames of the true motion, which is kept until the frames of that time are taken.

    Frames may be taken one by one or many at a time: they are equal to the last bit.
    """

    def __init__(self, backend: Backend, movers: Movers, config: SimulationConfig) -> None:
        self._backend, self._movers, self._off_wall = backend, movers, config.off_wall
        self._odometer = Odometry(config.robot, config.odometry, np.random.default_rng(config.seeds.odometry))
        self._devices = _devices(config)
        self._surface = Surface(config.surface, len(self._devices), config.seeds.surface)
        start = backend.drive(0.0, 0.0, 1)  # one step at rest tells where the robot stands
        self.truth = History(start.poses[-1], 1.0 / STEP_RATE)
        self._odometry = History(self._odometer.advance(*start.wheels.tolist()), CONTROL_PERIOD)
        self._commands: list[tuple[float, float]] = []  # of each control period from `_first_command` on
        self._first_command = 0
        self._due: list[_Due] = []
        self._next_odometry = 0

    @property
    def due(self) -> int:
        """Number of frames that can be taken."""
        return len(self._due)

    def record(self, command: tuple[float, float], motion: Motion) -> None:
        """Note the motion of one control period, and its command: speed [m/s] and turn rate [rad/s]."""
        self._commands.append(command)
        self.truth.extend(motion.poses)
        self._odometry.extend(self._odometer.advance(*motion.wheels.tolist())[None])

    def drive_tour(self, backend: FastBackend, driver: TourDriver, first: int, periods: int) -> tuple[int, bool]:
        """Let the robot drive on along its tour for at most so many control periods, of which `first` is the number of
        the first; return how many it drove, and whether it touched a wall."""
        odometer = self._odometer.odometer(periods)
        periods = len(odometer.uniform)
        done = Drive(np.empty((periods, 2)), np.empty((periods, CONTROL_STEPS, 3)), np.empty((periods, 3)))
        driven, contact = drive_tour(driver.tour, driver.state, backend.body, odometer, done, first, CONTROL_PERIOD)
        self._commands.extend(zip(*done.commands[:driven].T.tolist(), strict=True))
        self.truth.extend(done.poses[:driven].reshape(-1, 3))
        self._extend_odometry(done.odometry[:driven])
        return driven, contact

    def _extend_odometry(self, poses: NDArray[np.float64]) -> None:
        """Append odometry (n, 3) as if it had come pose by pose: the history takes the shorter way between two poses,
        also where a wheel that slips has turned it by more than half a turn in one period."""
        if np.abs(np.diff(poses[:, 2])).max(initial=0.0) < math.pi:
            self._odometry.extend(poses)
            return
        for pose in poses:
            self._odometry.extend(pose[None])

    def await_frames(self, first: int, last: int) -> None:
        """Make those frames due that are complete after `first` to `last` control periods: scans whose last beam was
        fired, and odometry up to then."""
        periods = first
        while True:
            device = min(self._devices, key=lambda d: d.stamp) if len(self._devices) > 1 else self._devices[0]
            complete = device.complete
            while complete > periods * CONTROL_PERIOD + 1e-9:
                if periods == last:
                    return
                periods += 1
            stamp = device.stamp
            self._await_odometry(stamp, periods)
            self._due.append(_Due(stamp, device, periods))
            device.advance()
            if self._next_odometry * CONTROL_PERIOD < stamp + 1e-9:  # the scan's frame has stated it
                self._next_odometry += 1

    def await_rest(self, periods: int) -> None:
        """Make the remaining frames due, which have no scan, of a drive that ended after so many control periods."""
        self._await_odometry(periods * CONTROL_PERIOD, periods)

    def _await_odometry(self, before: float, periods: int) -> None:
        while (stamp := self._next_odometry * CONTROL_PERIOD) < before - 1e-9:
            self._due.append(_Due(stamp, None, periods))
            self._next_odometry += 1

    def take(self, count: int, first: int) -> FrameTable:
        """Return the next `count` frames that are due, at least one; `first`: number of the first one in the drive."""
        due, self._due = self._due[:count], self._due[count:]
        stamps, periods = np.array([d.stamp for d in due]), np.array([d.periods for d in due])
        commanded = [int((d.stamp + 1e-9) / CONTROL_PERIOD) - self._first_command for d in due]
        table = FrameTable(
            stamps=stamps,
            odometry=_wrapped(self._odometry.at(stamps, 1 + periods)),
            twist=self._twist(due, stamps, periods),
            command=np.array([self._commands[k] for k in commanded]),
            truth=_wrapped(self.truth.at(stamps, 1 + CONTROL_STEPS * periods)),
            first=first,
            **self._scans(due),
        )
        self._forget_before(due[-1].stamp - 2.0 * CONTROL_PERIOD)
        return table

    def _scans(self, due: list[_Due]) -> dict[str, Any]:
        """Return the columns of a table that describe scans."""
        rows = [row for row, d in enumerate(due) if d.device is not None]
        devices = [d.device for d in due if d.device is not None]
        patterns: list[BeamPattern | None] = [None] * len(rows)
        readings = [np.empty(0)] * len(rows)
        for device in dict.fromkeys(devices):
            numbers = [number for number, other in enumerate(devices) if other is device]
            while numbers:
                found = self._scan(device, [due[rows[number]] for number in numbers])
                for number, (pattern, ranges) in zip(numbers, found, strict=False):
                    patterns[number], readings[number] = pattern, ranges
                del numbers[: len(found)]
        lidars = {name: k for k, name in enumerate(dict.fromkeys(device.name for device in devices))}
        distinct = {id(pattern): pattern for pattern in patterns if pattern is not None}
        places = {number: k for k, number in enumerate(distinct)}
        presets = [device.preset for device in devices]
        return {
            "scan_rows": np.array(rows, dtype=np.int64),
            "scan_lidars": np.array([lidars[device.name] for device in devices], dtype=np.int64),
            "scan_patterns": np.array([places[id(pattern)] for pattern in patterns], dtype=np.int64),
            "scan_starts": np.cumsum([0, *map(len, readings)], dtype=np.int64),
            "ranges": np.concatenate(readings) if readings else np.empty(0),
            "range_limits": np.array([(preset.range_min, preset.range_max) for preset in presets]).reshape(-1, 2),
            "mounts": np.array([device.lidar.mount for device in devices]).reshape(-1, 3),
            "lidars": tuple(lidars),
            "patterns": tuple(distinct.values()),
        }

    def _scan(self, device: Device, due: list[_Due]) -> list[tuple[BeamPattern, NDArray[np.float64]]]:
        """Return pattern and ranges of the next scans of one lidar: at least one, at most those that are due."""
        lidar = device.lidar
        sweep = lidar.sweep(len(due))
        scans, counts = len(sweep.patterns), np.diff(sweep.starts)
        times = np.repeat([d.stamp for d in due[:scans]], counts)
        if sweep.time_offsets is not None:
            times += sweep.time_offsets
        periods = np.repeat([d.periods for d in due[:scans]], counts)
        poses, positions = self.truth.between(times, 1 + CONTROL_STEPS * periods)
        origins, directions = place_beams(poses, positions, lidar.true_mount, sweep.true_angles)
        hits = self._backend.cast(origins, directions, device.preset.range_max, device.height)
        hits = self._movers.before(hits, origins, directions, times, 1 + periods)
        hits = self._surface.over(hits, origins, directions, self._devices.index(device))
        starts = sweep.starts.tolist()
        if self._off_wall is not None and device is self._devices[0]:
            hits = self._with_off_wall(self._off_wall, hits, [d.stamp for d in due], starts, origins, directions)
        ranges = lidar.ranges(hits)
        return [(pattern, ranges[a:b]) for pattern, (a, b) in zip(sweep.patterns, pairwise(starts), strict=True)]

    @staticmethod
    def _with_off_wall(
        recorded: OffWallBeams,
        hits: Hits,
        stamps: list[float],
        starts: list[int],
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
    ) -> Hits:
        """Return the hits of several scans, which begin at `starts`, with the recorded beams over them."""
        parts = [
            recorded.over(Hits(*(part[a:b] for part in hits)), stamp, origins[a:b], directions[a:b])
            for stamp, (a, b) in zip(stamps, pairwise(starts), strict=False)
        ]
        return Hits(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def _twist(self, due: list[_Due], stamps: NDArray[np.float64], periods: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the mean velocity in the robot's frame during each frame, (n, 3): over a scan, or a control period.

        It ends with the last odometry reading; if there is none after the frame's stamp, it is that of the last period.
        """
        seconds = [CONTROL_PERIOD if d.device is None else max(d.device.sweep_time, CONTROL_PERIOD) for d in due]
        ends = np.minimum(stamps + seconds, periods * CONTROL_PERIOD)
        begins = np.where(ends - stamps < 0.5 * CONTROL_PERIOD, ends - CONTROL_PERIOD, stamps)
        return self._odometry.velocities(begins, ends, 1 + periods)

    def _forget_before(self, time: float) -> None:
        """Drop what no later frame needs."""
        for history in (self.truth, self._odometry, self._movers):
            history.forget_before(time)
        drop = max(int(time / CONTROL_PERIOD) - self._first_command, 0)
        del self._commands[:drop]
        self._first_command += drop


def _wrapped(poses: Pose) -> Pose:
    """Return poses (n, 3) with headings in [-pi, pi)."""
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses
