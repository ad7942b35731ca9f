# SPDX-License-Identifier: MIT
"""The sensors of one simulated robot: true motion in, frames out."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from slam.scan import Scan
from slam.se2 import Pose, wrap_angle
from testbed.frame import Frame
from testbed.seeds import Stream, children
from testbed.simulation.config import CONTROL_PERIOD, SimulationConfig
from testbed.simulation.history import History
from testbed.simulation.movers.movers import Movers
from testbed.simulation.physics.backend import STEP_RATE, Backend
from testbed.simulation.robot._lidar_kernels import place_beams
from testbed.simulation.robot.lidar import Lidar
from testbed.simulation.robot.odometry import Odometry

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
        """Time of the first beam of the next scan [s]."""
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


class Sensors:
    """Makes frames of the true motion, which is kept until the scans taken during it are complete."""

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
        """Process the wheel angles since the beginning [rad]."""
        self._odometry.extend(self._odometer.advance(left, right)[None])

    def frames_until(self, time: float) -> Iterator[Frame]:
        """Yield the frames that are complete at `time` [s]: scans whose last beam was fired, odometry up to then."""
        while (device := min(self._devices, key=lambda d: d.stamp)).complete <= time + 1e-9:
            stamp = device.stamp
            yield from self.odometry_frames(before=stamp)
            yield self._scan_frame(device)
            device.advance()
            if self._next_odometry * CONTROL_PERIOD < stamp + 1e-9:  # the scan's frame has stated it
                self._next_odometry += 1
            for history in (self.truth, self._odometry, self._movers):
                history.forget_before(time - self._keep)

    def odometry_frames(self, before: float) -> Iterator[Frame]:
        """Yield the remaining frames without a scan up to the time `before` [s]."""
        while (stamp := self._next_odometry * CONTROL_PERIOD) < before - 1e-9:
            yield self._frame(stamp, CONTROL_PERIOD, None)
            self._next_odometry += 1

    def _scan_frame(self, device: Device) -> Frame:
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
        """Return the frame of `stamp` [s], with the mean velocity by odometry over the next `seconds`."""
        odometry = self._odometry.at(stamp)
        return Frame(
            stamp=stamp,
            odometry=_pose(odometry),
            scan=scan,
            lidar=lidar,
            twist=self._twist(stamp, odometry, seconds),
            command=self.commands[int((stamp + 1e-9) / CONTROL_PERIOD)],
            truth=_pose(self.truth.at(stamp)),
        )

    def _twist(self, stamp: float, odometry: tuple[float, float, float], seconds: float) -> Pose:
        """Return the mean velocity in the robot's frame over `seconds` from `stamp` on, (3,).

        It ends with the last odometry reading; if there is none after `stamp`, it is that of the last period.
        """
        end = min(stamp + seconds, self._odometry.end)
        if end - stamp < 0.5 * CONTROL_PERIOD:
            stamp = end - CONTROL_PERIOD
            odometry = self._odometry.at(stamp)
        x, y, theta = odometry
        x_end, y_end, theta_end = self._odometry.at(end)
        cos, sin, dx, dy, dt = math.cos(theta), math.sin(theta), x_end - x, y_end - y, end - stamp
        return np.array([(cos * dx + sin * dy) / dt, (-sin * dx + cos * dy) / dt, (theta_end - theta) / dt])


def _pose(unwrapped: tuple[float, float, float]) -> Pose:
    x, y, theta = unwrapped
    return np.array([x, y, wrap_angle(theta)])
