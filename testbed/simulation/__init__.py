# SPDX-License-Identifier: MIT
"""The simulator: a robot drives through a world, and its lidar and wheels produce frames."""

from testbed.simulation.config import SimulationConfig
from testbed.simulation.drivers.driver import DriverConfig
from testbed.simulation.robot.lidar import LidarLayers
from testbed.simulation.robot.odometry import OdometryConfig
from testbed.simulation.robot.surface import SurfaceConfig
from testbed.simulation.simulator import Simulation, simulate

__all__ = [
    "DriverConfig",
    "LidarLayers",
    "OdometryConfig",
    "Simulation",
    "SimulationConfig",
    "SurfaceConfig",
    "simulate",
]
