# SPDX-License-Identifier: MIT
"""The simulator: a robot drives the tour of a world; its lidar and wheels give frames."""

from testbed.simulation.drivers.driver import DriverConfig
from testbed.simulation.robot.lidar import LidarLayers
from testbed.simulation.robot.odometry import OdometryConfig
from testbed.simulation.simulator import Simulation, SimulationConfig, simulate

__all__ = ["DriverConfig", "LidarLayers", "OdometryConfig", "Simulation", "SimulationConfig", "simulate"]
