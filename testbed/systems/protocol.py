# SPDX-License-Identifier: MIT
"""The protocol of a SLAM system: what a class must have to be run, scored and compared. Nothing is inherited.

A system processes one recording, once: `start`, then `process` for each frame in the order of the recording, then
`finish`. It never sees the truth. Angles are in radians, lengths in metres, times in seconds.

Frames (REP-105): the robot's x axis points forward, y to the left; headings turn counter-clockwise. The system chooses
its own map frame, such as the robot's first pose: trajectory and map are aligned with the truth when they are scored,
but both must be in the same frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from testbed.frame import Frame


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Lidar:
    """What is known of a lidar before the drive: its first scan with beams."""

    name: str
    """The name by which frames refer to it (`Frame.lidar`)."""
    angles: NDArray[np.float64]
    """Direction of each beam in the lidar's frame [rad], counter-clockwise, 0 = forward, (beams,). Recorded scans may
    have another number of beams now and then: each scan carries its own angles."""
    range_min: float
    """Readings below this range are invalid [m]."""
    range_max: float
    """Readings of at least this range are no returns [m]."""
    mount: tuple[float, float, float]
    """`T_robot_lidar`: pose of the lidar on the robot [m, m, rad]."""

    def __repr__(self) -> str:
        """One line, for notebooks."""
        return f"<Lidar {self.name!r}: {len(self.angles)} beams, up to {self.range_max:g} m, mount {self.mount}>"


class System(Protocol):
    """A SLAM system. `MySlam()` makes one with its default settings.

    A system with settings is a class that also takes them: `MySlam(settings)`, where `settings` is a dataclass with a
    default for each field, and keeps them as the attribute `settings`. Then `--system-set NAME.FIELD=VALUE` changes
    one of them.

    A particle filter may also have a method `particles()`, which is called after `process` of a frame with a scan and
    returns poses `T_map_robot` (n, 3) and weights (n,), or None: they are drawn in the recording. It must not change
    the system, since it is not called after each scan of a long recording.
    """

    name: str
    """Name in tables and pictures, such as `my-slam`."""
    version: str
    """Version, which results are reported with."""

    def start(self, lidars: Sequence[Lidar], seed: int) -> None:
        """Prepare for a recording.

        lidars: the robot's lidars, at least one; seed: decides all random numbers of the system: same seed and same
        frames, same bits.
        """
        ...

    def process(self, frame: Frame) -> ArrayLike | None:
        """Process a frame; return the pose `T_map_robot` (3,) = x, y [m], theta [rad] at `frame.stamp`, or None.

        A frame has a stamp, the wheels' odometry `T_odom_robot` (3,), their twist where it is known, and the scan of
        one lidar, or none; a robot with several lidars gives a frame for each. None stands for no news: the robot is
        where the odometry leads to from the last pose. What is returned here is scored as the pose while driving.
        """
        ...

    def finish(self) -> tuple[Trajectory | None, OccupancyGrid | None]:
        """Return the final trajectory and map, each None where the system has none.

        The trajectory (stamps (n,), poses `T_map_robot` (n, 3)) is in the order of the recording, usually at stamps of
        frames; frames in between are carried by the odometry. None: the poses that `process` returned are final.
        """
        ...


SystemClass = type[Any]
"""A class that follows `System`. `Any`, since a protocol says nothing about how its classes are made."""


def lidars_of(frames: Sequence[Frame]) -> tuple[Lidar, ...]:
    """Return the lidars of a recording, in the order of their first scan with beams."""
    found: dict[str, Lidar] = {}
    for frame in frames:
        scan = frame.scan
        if scan is not None and len(scan.angles) and frame.lidar not in found:
            found[frame.lidar] = Lidar(
                name=frame.lidar,
                angles=scan.angles.copy(),
                range_min=scan.range_min,
                range_max=scan.range_max,
                mount=scan.mount,
            )
    return tuple(found.values())
