# SPDX-License-Identifier: MIT
"""Settings of a simulation: robot, lidars, driver, errors of the sensors, seeds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from testbed.presets import LidarPreset, RobotPreset, load_lidar, load_robot, robots
from testbed.seeds import RunSeeds
from testbed.simulation.drivers.driver import DriverConfig
from testbed.simulation.physics.backend import STEP_RATE
from testbed.simulation.physics.pybullet import is_installed
from testbed.simulation.robot.lidar import LidarLayers
from testbed.simulation.robot.odometry import OdometryConfig
from testbed.simulation.robot.off_wall import OffWallBeams
from testbed.simulation.robot.surface import SurfaceConfig

CONTROL_STEPS = 12
"""Steps of motion between two commands and two odometry readings (20 Hz)."""
CONTROL_PERIOD = CONTROL_STEPS / STEP_RATE
"""Time between two commands and two odometry readings [s]."""
MAX_DURATION = 10_000_000.0
"""Longest simulated time [s], 116 days."""


BackendName = Literal["auto", "pybullet", "fast"]
"""What moves the robot and casts the rays."""


def decided_backend(backend: BackendName) -> BackendName:
    """Return the backend that `auto` stands for on this machine; the others as they are."""
    if backend != "auto":
        return backend
    return "pybullet" if is_installed() else "fast"


@dataclass(frozen=True, kw_only=True)
class SimulationConfig:
    """Everything that a simulation needs except the world."""

    robot: RobotPreset = field(default_factory=lambda: load_robot("create3"))
    """The robot."""
    lidar: LidarPreset = field(default_factory=lambda: load_lidar("rplidar_a2"))
    """The lidar."""
    further_lidars: tuple[LidarPreset, ...] = ()
    """Further lidars at the robot's `further_lidar_mounts`. Each scans on its own; their first beams are spread evenly
    over the duration of a scan."""
    driver: DriverConfig = field(default_factory=DriverConfig)
    """The driver and its settings."""
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    """Errors of the wheel odometry."""
    lidar_layers: LidarLayers = field(default_factory=LidarLayers)
    """Imperfections of the lidar."""
    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    """Roughness of what the lidars see."""
    off_wall: OffWallBeams | None = None
    """Beams of a recorded drive that did not end on a wall, which the main lidar sees, too."""
    backend: BackendName = "auto"
    """pybullet: physics and rays of PyBullet, the reference; fast: exact arcs and rays without physics; auto: PyBullet
    where it is installed, else fast, decided here: it is never `auto` in a configuration that was made."""
    duration: float = 14_400.0
    """Longest simulated time [s]. The longest tour of the catalogue takes about 4000 s: the default stops only a drive
    that would go on for ever."""
    seeds: RunSeeds = field(default_factory=lambda: RunSeeds.from_seed(0))
    """Seeds of all random numbers."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "backend", decided_backend(self.backend))
        if not 0.0 < self.duration <= MAX_DURATION:
            raise ValueError(f"duration must be above 0 and at most {MAX_DURATION:,.0f} s, got {self.duration:g} s")
        if len(self.further_lidars) > len(self.robot.further_lidar_mounts):
            wanted = 1 + len(self.further_lidars)
            able = [name for name in robots() if len(load_robot(name).lidar_mounts) >= wanted]
            there = len(self.robot.lidar_mounts)
            raise ValueError(
                f"robot {self.robot.name!r} carries {there} lidar{'' if there == 1 else 's'}, not {wanted}: expected "
                f"{' or '.join(able) or 'another robot'}, or further_lidar_mounts in its preset"
            )
