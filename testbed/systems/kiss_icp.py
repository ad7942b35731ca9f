# SPDX-License-Identifier: MIT
"""KISS-ICP (Vizzo et al., RA-L 2023) on flat clouds: odometry by point-to-point ICP, without wheels and loop closing.

Source: https://github.com/PRBonn/kiss-icp (MIT). It is made for 3D lidars with some 100,000 points a scan; a 2D scan
gives it a few hundred in one plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version as version_of
from typing import Any

import numpy as np

from eval.trajectory.trajectory import Trajectory
from slam import se2
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.frame import Frame
from testbed.systems.protocol import Lidar

MIN_HITS = 10
"""Scans with fewer hits are left out."""


@dataclass(frozen=True, kw_only=True)
class KissIcpSettings:
    """Settings under the names of the package."""

    voxel_size: float = 0.2
    """Side of a voxel of its map [m]; the package takes a hundredth of the largest range."""
    initial_threshold: float = 0.5
    """First bound on the distance between a point and the map [m]; the package's default, for cars, is 2."""
    min_motion_th: float = 0.1
    """Smallest motion that adapts this bound [m]."""
    max_range: float = 30.0
    """Readings beyond this range are left out [m]."""


class KissIcpSystem:
    """`kiss_icp.kiss_icp.KissICP`, fed with the hits of each scan in the robot's frame."""

    name = "kiss-icp"

    def __init__(self, settings: KissIcpSettings | None = None) -> None:
        self.settings = settings or KissIcpSettings()

    @property
    def version(self) -> str:
        """Version of the package."""
        return f"kiss-icp {version_of('kiss-icp')}"

    def start(self, lidars: Sequence[Lidar], seed: int) -> None:
        """Create it with one thread, for the same bits each time; it draws no random numbers."""
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP

        config = KISSConfig()
        config.data.max_range = self.settings.max_range
        config.data.deskew = False  # it would need more than one scan's times in a turn
        config.mapping.voxel_size = self.settings.voxel_size
        config.adaptive_threshold.initial_threshold = self.settings.initial_threshold
        config.adaptive_threshold.min_motion_th = self.settings.min_motion_th
        config.registration.max_num_threads = 1
        self._icp: Any = KissICP(config)

    def process(self, frame: Frame) -> Pose | None:
        """Register the hits of a scan."""
        scan = frame.scan
        if scan is None or scan.hit.sum() < MIN_HITS:
            return None
        ranges, angles = scan.ranges[scan.hit], scan.angles[scan.hit]
        flat = se2.transform_points(scan.mount, np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)]))
        points = np.column_stack([flat, np.zeros(len(flat))])
        self._icp.register_frame(points, np.zeros(len(points)))
        T = self._icp.last_pose
        return np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])

    def finish(self) -> tuple[Trajectory | None, OccupancyGrid | None]:
        """Return nothing new: its poses are final, and its map is a cloud of points."""
        return None, None
