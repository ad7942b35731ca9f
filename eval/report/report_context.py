# SPDX-License-Identifier: MIT
"""One run as its report shows it: everything in one frame, with one zero of time."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from eval.files.run_reader import RunFiles
from eval.first_failure import Failure
from eval.trajectory.association import AssociationError, associate
from eval.trajectory.errors import AbsoluteError, absolute_error
from eval.trajectory.trajectory import Trajectory
from slam.se2 import Pose, compose, inverse


@dataclass(frozen=True, eq=False)
class ReportContext:
    """A run in the frame of the report: the truth's frame where the truth is known, else the map's."""

    run: RunFiles
    T_frame_estimate: Pose
    """The map's frame seen from the report's, (3,)."""
    errors: AbsoluteError | None
    """Errors of the estimate after SE(2) alignment, at the scans `rows`; None without truth."""
    rows: NDArray[np.intp]

    @classmethod
    def of(cls, run: RunFiles) -> Self:
        """Align the run's estimate to its truth, where both are known and share some time."""
        errors, rows = None, np.zeros(0, dtype=np.intp)
        if run.estimate is not None and run.truth is not None:
            with suppress(AssociationError):
                matched = associate(run.estimate, run.truth)
                errors, rows = absolute_error(matched, "se2"), matched.rows
        return cls(run, errors.alignment.T_reference_estimate if errors else np.zeros(3), errors, rows)

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

    @property
    def T_frame_odometry(self) -> Pose:
        """The odometry's frame seen from the report's, (3,): by the truth, else by the estimate's first pose."""
        run = self.run
        assert run.odometry is not None
        assert run.estimate is not None
        if run.truth is not None and self.errors is not None:
            return absolute_error(associate(run.odometry, run.truth), "se2").alignment.T_reference_estimate
        return compose(compose(self.T_frame_estimate, run.estimate.poses[0]), inverse(run.odometry.poses[0]))


def positions_in(T_frame: Pose, trajectory: Trajectory) -> NDArray[np.float64]:
    """Positions (n, 2) of a trajectory seen from another frame."""
    return compose(T_frame, trajectory.poses)[:, :2]
