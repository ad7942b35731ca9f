# SPDX-License-Identifier: MIT
"""Karto's correlative scan matcher with its pose graph and loop closing, by the package `yag-slam` (LGPL).

Source: Konolige et al., Sparse Pose Adjustment for 2D Mapping, IROS 2010; https://pypi.org/project/yag-slam.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version as version_of
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.trajectory import Trajectory
from slam import se2
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose
from testbed.frame import Frame
from testbed.systems.even_beams import evenly_spaced
from testbed.systems.protocol import Lidar

MIN_BEAMS = 10
"""Scans with fewer beams, or hits, are left out."""
BEYOND = 1.0
"""Readings that state no distance, such as inf, are put so far beyond the largest range [m]. No returns that have a
number keep it, as the package would get them from the recording."""


@dataclass(frozen=True, kw_only=True)
class KartoSettings:
    """Settings under the names of the package, with its defaults; `min_distance`, `min_angle` and `cell` are ours."""

    min_distance: float = 0.0
    """A scan is used after this distance driven since the last used one [m]; 0: every scan, as the package does."""
    min_angle: float = 0.0
    """A scan is also used after this angle turned [rad]."""
    scan_buffer_len: int = 10
    """Each scan is matched with so many before it."""
    loop_search_dist: float = 3.0
    """Loops are looked for within this distance [m]."""
    loop_search_min_chain_size: int = 10
    """Loops need so many consecutive scans in that distance."""
    min_response_coarse: float = 0.35
    """Loops need this response of the coarse match, 0 to 1."""
    min_response_fine: float = 0.45
    """Loops need this response of the fine match, 0 to 1."""
    cell: float = 0.05
    """Side of a cell of the map [m]."""
    map_range: float = 20.0
    """Readings up to this range are drawn into the map [m]."""


class KartoSystem:
    """`yag_slam.graph_slam.GraphSlam`, fed with scans of evenly spaced beams at the pose of the lidar."""

    name = "karto"

    def __init__(self, settings: KartoSettings | None = None) -> None:
        self.settings = settings or KartoSettings()

    @property
    def version(self) -> str:
        """Version of the package."""
        return f"yag-slam {version_of('yag-slam')}"

    def start(self, lidars: Sequence[Lidar], seed: int) -> None:
        """Create the matchers and an empty graph; the package draws no random numbers."""
        from yag_slam.graph_slam import GraphSlam
        from yag_slam.scan_matching import Scan2DMatcherCpp

        chosen = self.settings
        self._graph: Any = GraphSlam(
            Scan2DMatcherCpp({}),
            Scan2DMatcherCpp({}, loop=True),
            scan_buffer_len=chosen.scan_buffer_len,
            loop_search_dist=chosen.loop_search_dist,
            loop_search_min_chain_size=chosen.loop_search_min_chain_size,
            min_response_coarse=chosen.min_response_coarse,
            min_response_fine=chosen.min_response_fine,
        )
        self._used: list[tuple[float, tuple[float, float, float], Any]] = []  # stamp, mount and the package's scan
        self._last: Pose | None = None  # odometry at the last used scan

    def process(self, frame: Frame) -> Pose | None:
        """Match a scan with those before it, and close loops."""
        scan = frame.scan
        if (
            scan is None
            or len(scan.angles) < MIN_BEAMS
            or scan.hit.sum() < MIN_BEAMS
            or not self._moved(frame.odometry)
        ):
            return None
        self._last = frame.odometry
        x, y, theta = se2.compose(frame.odometry, np.asarray(scan.mount)).tolist()
        from yag_slam.models import LocalizedRangeScan

        ranges, angles = _even(scan)
        step = float(angles[1] - angles[0])
        limits = (scan.range_min, scan.range_max, scan.range_max)
        taken = LocalizedRangeScan(ranges, float(angles[0]), float(angles[-1]), step, *limits, x, y, theta)
        with contextlib.redirect_stdout(io.StringIO()):  # it prints each loop
            self._graph.process_scan(taken)
        self._used.append((frame.stamp, scan.mount, taken))
        return _pose(taken, scan.mount)

    def finish(self) -> tuple[Trajectory | None, OccupancyGrid | None]:
        """Return the poses of the graph at the used scans, and the map that the package draws from them."""
        if not self._used:
            return None, None
        poses = np.array([_pose(taken, mount) for _, mount, taken in self._used])
        return Trajectory(np.array([stamp for stamp, _, _ in self._used]), poses), self._map()

    def _moved(self, odometry: Pose) -> bool:
        if self._last is None:
            return True
        moved = se2.between(self._last, odometry)
        far, turned = float(np.hypot(moved[0], moved[1])), abs(float(moved[2]))
        return far >= self.settings.min_distance or turned >= self.settings.min_angle

    def _map(self) -> OccupancyGrid:
        """The package's own map; its cells are occupied, free or unknown."""
        found = self._graph.make_occupancy_grid(self.settings.cell, self.settings.map_range)
        image = np.asarray(found.image).reshape(found.height, found.width)
        return OccupancyGrid(
            probability=probabilities(image),
            resolution=self.settings.cell,
            origin=(float(found.offset.x), float(found.offset.y), 0.0),
        )


def probabilities(image: NDArray[Any]) -> NDArray[np.float32]:
    """Return P(occupied) of the package's cells (rows, cols): 0 occupied, 255 free, 200 unknown."""
    known = np.where(image == 0, 0.9, 0.1)
    unknown = (image != 0) & (image != 255)
    return np.where(unknown, np.nan, known).astype(np.float32)


def _pose(taken: Any, mount: tuple[float, float, float]) -> Pose:
    """`T_map_robot` of a scan of the package, whose pose is the lidar's."""
    pose = taken.corrected_pose
    lidar = np.array([pose.x, pose.y, pose.euler[-1]])
    robot: Pose = se2.compose(lidar, se2.inverse(np.asarray(mount, dtype=np.float64)))
    return robot


def _even(scan: Scan) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ranges and evenly spaced, increasing angles; what states no distance gets a range beyond the limit."""
    beams, angles = evenly_spaced(scan)
    stated = scan.hit | (scan.no_return & np.isfinite(scan.ranges))
    ranges = np.where(stated, scan.ranges, scan.range_max + BEYOND)
    return ranges[beams], angles
