# SPDX-License-Identifier: MIT
"""What the systems that are made of this package's filter share; a run can follow them (`testbed.run.followed`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.trajectory import Trajectory
from slam.config import FilterConfig
from slam.localization import Localization
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.estimation.estimation import Estimation
from testbed.estimation.known_map import KnownMap, failure_reason, localization_metrics
from testbed.estimation.self_check import localization_self_check, self_check_metrics
from testbed.estimation.snapshot import take_snapshot
from testbed.frame import Frame
from testbed.run.estimate import Estimate
from testbed.seeds import RunSeeds
from testbed.systems.own_version import own_version
from testbed.systems.protocol import Lidar
from testbed.views.view import Snapshot


class FilterSystem:
    """The filter over a recording: it maps, or localises in a map that is given."""

    name = "gmapping"
    version = own_version()

    def __init__(
        self, config: FilterConfig, *, refine: bool, threads: int | None, known_map: KnownMap | None = None
    ) -> None:
        """known_map: the map to localise in; None = a map is made"""
        self._config, self._refine, self._threads = config, refine, threads
        self._known_map = known_map
        self._estimation: Estimation | None = None

    # The protocol.

    def start(self, lidars: Sequence[Lidar], seed: int) -> None:
        """Create the filter with its stream of the seed's random numbers."""
        stream = RunSeeds.from_seed(seed).filter
        self._estimation = Estimation(self._config, stream, self._threads, self._known_map)

    def process(self, frame: Frame) -> Pose | None:
        """Process a frame; the pose is that of the best particle."""
        report = self.following().process(frame)
        return None if report is None else report.pose

    def particles(self) -> tuple[Pose, NDArray[np.float64]] | None:
        """Return all particles; None where there is only one, and while a localisation has none."""
        mapper = self.following().mapper
        return (mapper.poses, mapper.weights) if len(mapper.poses) > 1 else None

    def finish(self) -> tuple[Trajectory | None, OccupancyGrid | None]:
        """Return poses at all frames and the map, after the final pass where that is wanted."""
        estimation = self.following()
        if not len(estimation.scan_frames):
            return None, None
        estimate = estimation.filtered()
        if self.refines:
            estimate = estimation.refined(estimate)
        return estimate.dense, estimate.map if self.makes_map else None

    # What a run follows.

    @property
    def makes_map(self) -> bool:
        """Whether it makes a map; otherwise one was given."""
        return self._known_map is None

    @property
    def refines(self) -> bool:
        """Whether it makes a final pass, which needs a map of its own."""
        return self._refine and self.makes_map

    @property
    def notes(self) -> Sequence[str]:
        """What is doubtful about the map that was given."""
        return () if self._known_map is None else self._known_map.notes

    def following(self) -> Estimation:
        """Return what has been kept since `start`."""
        assert self._estimation is not None
        return self._estimation

    def map(self) -> OccupancyGrid:
        """Return the map of the best particle as it is now."""
        return self.following().mapper.map()

    def snapshot(self, frame: Frame, *, collided: bool) -> Snapshot:
        """Return what a view shows of the last frame, which has a scan."""
        estimation = self.following()
        assert estimation.report is not None
        return take_snapshot(frame, estimation.report, estimation.mapper, collided=collided)

    def own_metrics(self, estimate: Estimate, *, replay: bool) -> dict[str, Any]:
        """Return the group `self_check` where it makes a map, and its number of particles."""
        own = {"particles": self._config.particles}
        if not self.makes_map:
            return own
        return {"self_check": self_check_metrics(self.following(), estimate, replay=replay), **own}

    def last_word(self, estimate: Estimate, ended: str | None) -> dict[str, Any]:
        """Return nothing where it makes a map; else `localization`, and the outcome where that failed."""
        known, estimation = self._known_map, self.following()
        if known is None:
            return {}
        assert isinstance(estimation.mapper, Localization)
        truth = estimation.trajectory_at_scans("truth")
        found = localization_metrics(known, estimation.mapper.status, estimation.frames, estimate.at_scans, truth)
        start = float(estimation.stamps[estimation.scan_frames[0]])
        groups = {"self_check": localization_self_check(found, start), "localization": found}
        astray = failure_reason(found)
        if ended is not None or astray is None:
            return groups
        return {"outcome": "lost", "outcome_reason": astray, **groups}
