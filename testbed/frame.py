# SPDX-License-Identifier: MIT
"""One time step's sensor data: what simulators and recorded logs give to an estimator."""

from __future__ import annotations

from dataclasses import dataclass

from slam.scan import Scan
from slam.se2 import Pose


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One stamp of a recording or simulation; frames without a scan carry odometry only."""

    stamp: float
    """Time [s]; in recorded logs not always increasing: process in order."""
    odometry: Pose
    """`T_odom_robot` at `stamp`, integrated wheel odometry, (3,)."""
    scan: Scan | None = None
    """The scan whose first beam was measured at `stamp`."""
    lidar: str = "laser"
    """Name of the coordinate frame of the lidar that took the scan: tells the lidars of one robot apart."""
    twist: Pose | None = None
    """Velocity of the robot in its own frame while the scan was taken, as the odometry saw it
    `(vx, vy, omega)` [m/s, m/s, rad/s], (3,); None = unknown."""
    command: tuple[float, float] | None = None
    """Speed and turn rate that the robot was told to keep from `stamp` on [m/s, rad/s]; None = unknown."""
    truth: Pose | None = None
    """`T_world_robot` at `stamp`, if known, (3,). Never shown to the estimator."""
