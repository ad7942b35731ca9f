# SPDX-License-Identifier: MIT
"""The data of one scan for a view."""

from __future__ import annotations

import math
from functools import partial

from slam.gmapping import GMapping
from slam.localization import Localization
from slam.step.step_report import StepReport
from testbed.frame import Frame
from testbed.views.map_cells import map_cells
from testbed.views.view import Proposal, Snapshot


def take_snapshot(
    frame: Frame, report: StepReport, mapper: GMapping | Localization, *, collided: bool = False
) -> Snapshot:
    """Return the data of a scan that the filter has just processed."""
    poses = mapper.poses
    has_particles = len(poses) > 0  # a search of the whole map has none before its first scan
    return Snapshot(
        stamp=frame.stamp,
        estimate=report.pose,
        odometry=frame.odometry,
        truth=frame.truth,
        scan=frame.scan,
        step=report,
        poses=poses if has_particles else None,
        weights=mapper.weights if has_particles else None,
        proposal=_proposal(report),
        localization=mapper.status.state if isinstance(mapper, Localization) and report.updated else None,
        collided=collided,
        path=mapper.path,
        best=mapper.best if isinstance(mapper, GMapping) else report.best,
        cells=partial(map_cells, mapper.maps) if isinstance(mapper, GMapping) else None,
        map=mapper.map,
    )


def _proposal(report: StepReport) -> Proposal | None:
    """Return how the best particle's new pose was found; None where no samples were drawn."""
    proposed, best = report.proposed, report.best
    if proposed is None or math.isnan(proposed.samples[best, 0, 0]):  # all of a particle's samples are drawn, or none
        return None
    return Proposal(
        samples=proposed.samples[best],
        weights=proposed.sample_weights[best],
        mean=proposed.mean[best],
        covariance=proposed.covariance[best],
    )
