# SPDX-License-Identifier: MIT
"""The data of one scan for a view."""

from __future__ import annotations

import numpy as np

from slam.gmapping import GMapping
from slam.localization import Localization
from slam.step.step_report import StepReport
from testbed.frame import Frame
from testbed.views.view import Snapshot


def take_snapshot(
    frame: Frame, report: StepReport, mapper: GMapping | Localization, *, collided: bool = False
) -> Snapshot:
    """Return the data of a scan that the filter has just processed."""
    samples = None if report.proposed is None else report.proposed.samples[report.best]
    if samples is not None and np.isnan(samples).any():  # none were drawn: matching failed, or another proposal
        samples = None
    return Snapshot(
        stamp=frame.stamp,
        estimate=report.pose,
        odometry=frame.odometry,
        truth=frame.truth,
        scan=frame.scan,
        step=report,
        poses=mapper.poses,
        weights=mapper.weights,
        proposal_samples=samples,
        collided=collided,
        path=mapper.path,
        map=mapper.map,
    )
