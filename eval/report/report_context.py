# SPDX-License-Identifier: MIT
"""One run as its report shows it: everything in one frame, with one zero of time."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from eval.files.run_reader import RunFiles
from eval.filter.step_table import Columns, column, pose_columns
from eval.first_failure import Failure
from eval.trajectory.association import Association, AssociationError, associate
from eval.trajectory.errors import AbsoluteError, absolute_error
from eval.trajectory.trajectory import Trajectory
from slam.se2 import Pose, between, compose, inverse


@dataclass(frozen=True, eq=False)
class ReportContext:
    """A run in the frame of the report: the truth's frame where the truth is known, else the map's."""

    run: RunFiles
    T_frame_estimate: Pose
    """The map's frame seen from the report's, aligned over all poses: for maps and their measures, (3,)."""
    T_frame_start: Pose
    """The same, aligned at the first scan, as in the recording: for paths and for errors over time, (3,)."""
    errors: AbsoluteError | None
    """Errors of the estimate after SE(2) alignment, at the scans `rows`; None without truth."""
    rows: NDArray[np.intp]

    @classmethod
    def of(cls, run: RunFiles) -> Self:
        """Align the run's estimate to its truth, where both are known and share some time."""
        if run.estimate is not None and run.truth is not None:
            with suppress(AssociationError):
                matched = associate(run.estimate, run.truth)
                errors = absolute_error(matched, "se2")
                at_start = None if run.steps is None else _alignment_of_steps(run.steps)
                if at_start is None:
                    at_start = _first_alignment(matched)
                return cls(run, errors.alignment.T_reference_estimate, at_start, errors, matched.rows)
        return cls(run, np.zeros(3), np.zeros(3), None, np.zeros(0, dtype=np.intp))

    @property
    def failure(self) -> Failure | None:
        """Where it went wrong."""
        return self.run.failure.failure if self.run.failure is not None else None

    @property
    def start(self) -> float:
        """Stamp that counts as time 0 [s]."""
        return float(self.run.estimate.stamps[0]) if self.run.estimate is not None else 0.0

    @property
    def failure_time(self) -> float | None:
        """Time at which the run went wrong [s], if it did."""
        return self.failure.stamp - self.start if self.failure is not None and self.failure.bad else None

    def errors_from_start(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Errors of the estimate with both paths aligned at the first scan [m] and [deg], at the scans `rows`, (n,);
        empty without truth."""
        if self.errors is None or self.run.estimate is None or self.run.truth is None:
            return np.zeros(0), np.zeros(0)
        matched = associate(self.run.estimate, self.run.truth)
        miss = between(matched.reference.poses, compose(self.T_frame_start, matched.estimate.poses))
        return np.hypot(miss[:, 0], miss[:, 1]), np.degrees(np.abs(miss[:, 2]))

    @property
    def T_frame_odometry(self) -> Pose:
        """The odometry's frame seen from the report's, (3,), aligned at the first scan: to the truth, else to the
        estimate."""
        run = self.run
        assert run.odometry is not None
        assert run.estimate is not None
        if run.truth is not None and self.errors is not None:
            return _first_alignment(associate(run.odometry, run.truth))
        return compose(compose(self.T_frame_start, run.estimate.poses[0]), inverse(run.odometry.poses[0]))


def _first_alignment(matched: Association) -> Pose:
    """The motion that takes the first matched pose of an estimate onto the true one, (3,)."""
    return compose(matched.reference.poses[0], inverse(matched.estimate.poses[0]))


def _alignment_of_steps(steps: Columns) -> Pose | None:
    """The alignment by which the errors in the table of a run were measured, (3,); None where it has none."""
    if "error_m" not in steps:
        return None
    known = np.flatnonzero(np.isfinite(column(steps, "error_m")))
    if len(known) == 0:
        return None
    first = known[0]
    if column(steps, "error_m")[first] > 1e-9:  # in the true map's own frame nothing is aligned
        return np.zeros(3)
    return compose(pose_columns(steps, "true_")[first], inverse(pose_columns(steps)[first]))


def positions_in(T_frame: Pose, trajectory: Trajectory) -> NDArray[np.float64]:
    """Positions (n, 2) of a trajectory seen from another frame."""
    return compose(T_frame, trajectory.poses)[:, :2]
