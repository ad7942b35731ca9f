# SPDX-License-Identifier: MIT
"""What the wheels say, corrected by nothing: the baseline of every comparison."""

from __future__ import annotations

from collections.abc import Sequence

from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.frame import Frame
from testbed.systems.own_version import own_version
from testbed.systems.protocol import Lidar


class OdometrySystem:
    """Reports the odometry as the estimate; it has no map."""

    name = "odometry"
    version = own_version()

    def start(self, lidars: Sequence[Lidar], seed: int) -> None:
        """Do nothing: the odometry needs no preparation."""

    def process(self, frame: Frame) -> Pose | None:
        """Return the odometry of the frame, (3,)."""
        return frame.odometry

    def finish(self) -> tuple[Trajectory | None, OccupancyGrid | None]:
        """Return nothing new: the poses that were reported are final."""
        return None, None
