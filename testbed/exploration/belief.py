# SPDX-License-Identifier: MIT
"""The input of a driver that steers by the estimate: the filter's pose and map, and the last scans."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose, inverse, transform_points
from slam.sensor.deskew import exp_twist
from slam.sensor.rays import make_rays


@dataclass(frozen=True, kw_only=True, eq=False)
class Belief:
    """The filter's estimate at one time."""

    stamp: float
    """Time of the estimate [s]."""
    pose: Pose
    """`T_map_robot` of the most likely particle, (3,), extrapolated by odometry from its scan to `stamp`."""
    scans: tuple[Scan, ...]
    """The last scan of each lidar, at least one."""
    twist: Pose | None = None
    """Velocity of the robot by odometry `(vx, vy, omega)` [m/s, m/s, rad/s], (3,); None = unknown, or impossible."""
    map: Callable[[], OccupancyGrid]
    """Draws the most likely map when it is called."""

    def obstacles(self) -> NDArray[np.float64]:
        """Return the end points of the beams of the last scans in the robot's frame at `stamp` [m], (hits, 2)."""
        return np.concatenate([self._ends(scan) for scan in self.scans])

    def _ends(self, scan: Scan) -> NDArray[np.float64]:
        rays = make_rays([scan], usable_range=np.inf, twist=self.twist)
        ends = rays.ends[rays.hit]
        if self.twist is None:
            return ends
        return transform_points(inverse(exp_twist(self.twist, self.stamp - scan.stamp)), ends)
