# SPDX-License-Identifier: MIT
"""Sensor data of one time step, which simulators and recorded logs give to an estimator."""

from __future__ import annotations

from dataclasses import dataclass

from slam.scan import Scan
from slam.se2 import Pose


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Frame:
    """One time step of a recording or simulation; frames without a scan have odometry only."""

    stamp: float
    """Time [s]. It does not always increase in recorded logs; frames are processed in their order."""
    odometry: Pose
    """`T_odom_robot` at `stamp`, integrated wheel odometry, (3,)."""
    scan: Scan | None = None
    """The scan whose first beam was measured at `stamp`."""
    lidar: str = "laser"
    """Name of the coordinate frame of the lidar that took the scan; it identifies the lidar."""
    twist: Pose | None = None
    """Velocity of the robot in its own frame during the scan by odometry `(vx, vy, omega)` [m/s, m/s, rad/s], (3,);
    None = unknown."""
    command: tuple[float, float] | None = None
    """Commanded speed and turn rate from `stamp` on [m/s, rad/s]; None = unknown."""
    truth: Pose | None = None
    """`T_world_robot` at `stamp`, if known, (3,). Never shown to the estimator."""

    def __repr__(self) -> str:
        """One line, for notebooks."""
        x, y, theta = self.odometry
        scan = f"{self.scan.ranges.size} readings of {self.lidar!r}" if self.scan is not None else "no scan"
        return f"<Frame {self.stamp:.3f} s: odometry ({x:.3f}, {y:.3f}, {theta:.3f}), {scan}>"
