# SPDX-License-Identifier: MIT
"""The driver of `--driver explore`: it connects the simulator, the filter and an explorer."""

from __future__ import annotations

from collections.abc import Callable

from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import compose
from slam.sensor.deskew import exp_twist
from slam.sensor.possible_motion import possible_twist
from slam.step.step_report import StepReport
from testbed.exploration.belief import Belief
from testbed.exploration.explorer import Explorer
from testbed.frame import Frame


class ExploreDriver:
    """A driver that steers by the estimate, which `observe` updates with each scan; it ignores the true pose."""

    share = None
    """Unknown, because the size of the unexplored area is unknown."""

    def __init__(self, explorer: Explorer) -> None:
        self._explorer = explorer
        self._latest: tuple[Frame, StepReport, Callable[[], OccupancyGrid]] | None = None
        self._scans: dict[str, Scan] = {}  # the last one of each lidar

    @property
    def finished(self) -> bool:
        """Whether nothing is left to explore."""
        return self._explorer.finished

    @property
    def stuck(self) -> bool:
        """Whether the robot could not free itself."""
        return self._explorer.stuck

    @property
    def recoveries(self) -> int:
        """Number of times that the robot backed off."""
        return self._explorer.recoveries

    def observe(self, frame: Frame, report: StepReport, make_map: Callable[[], OccupancyGrid]) -> None:
        """Store the estimate after a frame with a scan; make_map: returns the map as it is then."""
        self._latest = (frame, report, make_map)
        if frame.scan is not None:
            self._scans[frame.lidar] = frame.scan

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float]:
        """Return speed [m/s] and turn rate [rad/s]; the true pose (x, y, theta) is ignored.

        The estimate is extrapolated to `stamp` [s] by odometry. Before the first scan the robot stands still.
        """
        if self._latest is None:
            return 0.0, 0.0
        frame, report, make_map = self._latest
        pose, twist = report.pose, possible_twist(frame.twist)
        if twist is not None:
            pose = compose(pose, exp_twist(twist, stamp - frame.stamp))
        scans = tuple(self._scans.values())
        belief = Belief(stamp=stamp, pose=pose, scans=scans, twist=twist, map=make_map)
        return self._explorer.command(belief)

    def wait(self, stamp: float) -> tuple[float, float]:
        """Return the command 0, 0, and do not count the time up to `stamp` [s] as lack of progress."""
        self._explorer.wait(stamp)
        return 0.0, 0.0
