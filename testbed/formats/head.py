# SPDX-License-Identifier: MIT
"""What a writer must know of a recording before its first frame, so that frames can be written while they are made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from slam.occupancy import OccupancyGrid
from testbed.formats.log import Log
from testbed.frame_table import FrameTable


@dataclass(frozen=True, kw_only=True)
class LidarHead:
    """One lidar of a recording."""

    mount: tuple[float, float, float]
    """`T_robot_lidar` [m, m, rad]."""
    range_max: float
    """Readings from here on are no returns [m]."""
    scan_time: float = 0.0
    """Time between two scans [s]; 0 = unknown."""
    model: str = ""
    """Name of the device; empty = unknown."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LogHead:
    """A recording without its frames."""

    lidars: Mapping[str, LidarHead] = field(default_factory=dict)
    """The lidars by name, in the order of their first scans."""
    truth_map: OccupancyGrid | None = None
    """The true map, where it is known."""
    robot_urdf: str | None = None
    """The robot's description, where it is known."""
    licence: str = ""
    """Licence of the data as the Hugging Face hub names it, such as `cc-by-4.0`; empty = unknown."""

    @classmethod
    def of(cls, log: Log) -> LogHead:
        """The head of a log: mounts and ranges are those of each lidar's first scan."""
        return cls(lidars=lidars_of(log.table), truth_map=log.truth_map, robot_urdf=log.robot_urdf)


def lidars_of(table: FrameTable) -> dict[str, LidarHead]:
    """The lidars that took scans; the time between scans is the median of the differences of their stamps."""
    found = {}
    for number in np.unique(table.scan_lidars, return_index=True)[1].argsort():
        lidar = int(np.unique(table.scan_lidars)[number])
        scans = np.flatnonzero(table.scan_lidars == lidar)
        gaps = np.diff(table.stamps[table.scan_rows[scans]])
        x, y, theta = table.mounts[scans[0]].tolist()
        found[table.lidars[lidar]] = LidarHead(
            mount=(x, y, theta),
            range_max=float(table.range_limits[scans[0], 1]),
            scan_time=max(float(np.median(gaps)), 0.0) if gaps.size else 0.0,
        )
    return found
