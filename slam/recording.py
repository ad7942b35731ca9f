# SPDX-License-Identifier: MIT
"""A filter with everything that it is fed: the final pass then lacks nothing of what the filter was told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam.gmapping import GMapping
from slam.motion.continuous_odometry import join_odometry
from slam.motion.interpolation import between_updates
from slam.refinement.progress import Watch, unwatched
from slam.refinement.refine import Refined, refine
from slam.scan import Scan, listed
from slam.step.step_report import StepReport


class Recording:
    """Feeds a filter, and keeps scans, odometry, times and velocities for the final pass.

    It takes the memory of the scans, which the filter alone does not keep: 6 kB for one of 360 beams.
    """

    def __init__(self, mapper: GMapping) -> None:
        """Begin with a filter that has seen no scan; raises ValueError where it has."""
        if mapper.scans > 0:
            raise ValueError(f"a recording begins with a filter that has seen no scan, got {mapper}")
        self.mapper = mapper
        self._odometry: list[se2.Pose] = []
        self.scans: list[Scan] = []
        """All scans, in the order in which they came."""
        self._twists: list[NDArray[np.float64] | None] = []
        self._steps: list[int] = []  # the step that each scan belongs to

    def process(
        self, odometry: ArrayLike, scan: Scan | Sequence[Scan], *, twist: ArrayLike | None = None
    ) -> StepReport:
        """Process one scan, or the scans of several lidars at the same time, as `GMapping.process` does.

        Raises:
            TypeError, ValueError: what `GMapping.process` raises.
            ValueError: a scan tells the times of its beams but `twist` is None: without the velocity the motion within
                the scan would remain in it, unnoticed.
        """
        scans = listed(scan)
        if twist is None and any(each.has_beam_times for each in scans):
            raise ValueError(
                "the scan has time_offsets, but twist is missing: pass twist=(vx, vy, omega) [m/s, m/s, rad/s], the "
                "robot's velocity while the scan was taken, or leave time_offsets out"
            )
        report = self.mapper.process(odometry, scan, twist=twist)
        for each in scans:
            self._odometry.append(np.array(odometry, dtype=np.float64))
            self.scans.append(each)
            self._twists.append(None if twist is None else np.array(twist, dtype=np.float64))
            self._steps.append(self.mapper.scans - 1)
        return report

    @property
    def stamps(self) -> NDArray[np.float64]:
        """Time of each step: the stamp of its first scan [s], (steps,)."""
        return np.array([self.scans[row].stamp for row in self._rows()])

    def poses(self) -> se2.Pose:
        """Poses by the best particle at every step, used or not, (steps, 3)."""
        updates = np.asarray(self.mapper.update_scans)
        return between_updates(self._joined()[self._rows()], updates, self.mapper.path())

    def refine(self, *, threads: int | None = None, watch: Watch = unwatched) -> Refined:
        """Make the final pass (`slam.refine`) over everything so far; its poses and covariances are of the steps."""
        steps, stamps = np.array(self._steps), np.array([scan.stamp for scan in self.scans])
        refined = refine(
            self._joined(),
            self.scans,
            self.poses()[steps],
            self.mapper.config,
            twists=self._twists,
            stamps=stamps if np.ptp(stamps) > 0.0 else None,
            threads=threads,
            watch=watch,
        )
        rows = self._rows()
        return replace(refined, poses=refined.poses[rows], covariances=refined.covariances[rows])

    def _rows(self) -> NDArray[np.intp]:
        """Row of the first scan of each step, (steps,)."""
        return np.flatnonzero(np.diff(self._steps, prepend=-1))

    def _joined(self) -> se2.Pose:
        """`T_odom_robot` at every scan, joined where the odometry started again, (scans, 3)."""
        return join_odometry(np.array([scan.stamp for scan in self.scans]), np.array(self._odometry))

    def __repr__(self) -> str:
        """One line, for notebooks."""
        return f"<Recording: {len(self.scans)} scans, {self.mapper}>"
