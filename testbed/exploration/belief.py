# SPDX-License-Identifier: MIT
"""What a driver that steers by the estimate is told: pose and map of the filter, the last scans. Never the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose, transform_points


@dataclass(frozen=True, kw_only=True, eq=False)
class Belief:
    """The estimate at one time."""

    stamp: float
    """Now [s]."""
    pose: Pose
    """`T_map_robot` of the most likely particle, (3,), carried on by odometry from its scan until now."""
    scans: tuple[Scan, ...]
    """The last scan of each lidar, at least one."""
    map: Callable[[], OccupancyGrid]
    """Gives the most likely map; drawn when it is asked for."""

    def obstacles(self) -> NDArray[np.float64]:
        """Where the beams of the last scans ended, robot's frame [m], (hits, 2)."""
        return np.concatenate([_ends(scan) for scan in self.scans])


def _ends(scan: Scan) -> NDArray[np.float64]:
    hit = scan.hit
    ends = scan.ranges[hit, None] * np.column_stack([np.cos(scan.angles[hit]), np.sin(scan.angles[hit])])
    return transform_points(scan.mount, ends)
