# SPDX-License-Identifier: MIT
"""What a run asks of a system that it follows scan by scan, whatever its estimator is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from slam.refinement.progress import Watch
from slam.se2 import Pose
from slam.step.step_report import StepReport
from testbed.frame import Frame
from testbed.run.estimate import Estimate
from testbed.run.frame_store import FrameStore
from testbed.run.step_table import StepTable
from testbed.views.view import Snapshot


class Following(Protocol):
    """What a followed system has kept of a recording so far, and what it makes of it."""

    frames: FrameStore
    """The frames that were processed."""
    steps: StepTable
    """What happened at each scan."""
    report: StepReport | None
    """What happened at the last frame; None if it has no scan."""

    @property
    def scan_frames(self) -> NDArray[np.intp]:
        """Indices of the frames with a scan, (scans,)."""
        ...

    @property
    def odometry(self) -> Pose:
        """`T_odom_robot` at every frame, joined where the odometry started again, (frames, 3)."""
        ...

    @property
    def usable_range(self) -> float:
        """Readings beyond it are not used [m]."""
        ...

    def trajectory_at_scans(self, source: Literal["odometry", "truth"]) -> Trajectory | None:
        """Return odometry or truth at every scan where it is known; None if it is known at no scan."""
        ...

    def online(self) -> Trajectory:
        """Return the pose that was reported at each scan; needs at least one scan."""
        ...

    def filtered(self) -> Estimate:
        """Return the estimate without a final pass; needs at least one scan."""
        ...

    def refined(self, estimate: Estimate, watch: Watch = ...) -> Estimate:
        """Return the estimate after the final pass over all frames, which `watch` is told of and may end early."""
        ...


@runtime_checkable
class Followed(Protocol):
    """A system (`testbed.systems.protocol.System`) that a run can follow while a robot drives.

    A run starts it before any frame is known, so `start` gets no lidars. It asks for both results instead of `finish`,
    without the final pass and after it, and shows how far that pass has come.
    """

    name: str
    version: str

    @property
    def makes_map(self) -> bool:
        """Whether it makes a map; otherwise one was given."""
        ...

    @property
    def refines(self) -> bool:
        """Whether it makes a final pass."""
        ...

    @property
    def notes(self) -> Sequence[str]:
        """What is doubtful about what it was given."""
        ...

    def start(self, lidars: Sequence[Any], seed: int) -> None:
        """Prepare for a recording; seed: decides all random numbers of the system."""
        ...

    def process(self, frame: Frame) -> ArrayLike | None:
        """Process a frame; return the pose, or None where it has no scan."""
        ...

    def following(self) -> Following:
        """Return what has been kept since `start`."""
        ...

    def map(self) -> OccupancyGrid:
        """Return the map as it is now."""
        ...

    def snapshot(self, frame: Frame, *, collided: bool) -> Snapshot:
        """Return what a view shows of the last frame, which has a scan."""
        ...

    def own_metrics(self, estimate: Estimate, *, replay: bool) -> Mapping[str, Any]:
        """Return what only the system can say of an estimate, for `metrics.json`.

        replay: whether it may take its time and go through all scans again
        """
        ...

    def last_word(self, estimate: Estimate, ended: str | None) -> Mapping[str, Any]:
        """Return what replaces or adds to `metrics.json` after scoring; ended: see `eval.outcome.judge`."""
        ...
