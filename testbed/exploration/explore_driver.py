# SPDX-License-Identifier: MIT
"""`--driver explore`: between the simulator, which asks for commands, and an explorer, which asks for the estimate."""

from __future__ import annotations

from slam.gmapping import GMapping
from slam.scan import Scan
from slam.se2 import compose
from slam.sensor.rays import exp_twist
from slam.step.step_report import StepReport
from testbed.exploration.belief import Belief
from testbed.exploration.explorer import Explorer
from testbed.frame import Frame


class ExploreDriver:
    """A driver of the simulator that is told the estimate scan by scan, and never looks at the truth."""

    share = None
    """Nobody knows how much there is to explore."""

    def __init__(self, explorer: Explorer) -> None:
        self._explorer = explorer
        self._latest: tuple[Frame, StepReport, GMapping] | None = None
        self._scans: dict[str, Scan] = {}  # the last one of each lidar

    @property
    def finished(self) -> bool:
        """There is nothing left to explore."""
        return self._explorer.finished

    @property
    def stuck(self) -> bool:
        """The robot could not free itself."""
        return self._explorer.stuck

    @property
    def recoveries(self) -> int:
        """How often the robot had to free itself."""
        return self._explorer.recoveries

    def observe(self, frame: Frame, report: StepReport, mapper: GMapping) -> None:
        """Take in what the filter made of a frame with a scan."""
        self._latest = (frame, report, mapper)
        if frame.scan is not None:
            self._scans[frame.lidar] = frame.scan

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float]:
        """Speed [m/s] and turn rate [rad/s] by the estimate, carried on to `stamp` [s] by odometry; the true pose is
        not looked at. Stands still before the first scan."""
        if self._latest is None:
            return 0.0, 0.0
        frame, report, mapper = self._latest
        pose = report.pose
        if frame.twist is not None:
            pose = compose(pose, exp_twist(frame.twist, stamp - frame.stamp))
        return self._explorer.command(Belief(stamp=stamp, pose=pose, scans=tuple(self._scans.values()), map=mapper.map))

    def wait(self, stamp: float) -> tuple[float, float]:
        """Stand still for someone in the way."""
        self._explorer.wait(stamp)
        return 0.0, 0.0
