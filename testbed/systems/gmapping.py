# SPDX-License-Identifier: MIT
"""The filter of this package as a system, with its final pass, and as a plain scan matcher."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.trajectory import Trajectory
from slam.config import FilterConfig
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.frame import Frame
from testbed.run.estimation import Estimation
from testbed.run.known_map import KnownMap
from testbed.seeds import RunSeeds
from testbed.systems.protocol import Lidar


def own_version() -> str:
    """Return the version of this package."""
    try:
        return version("slam-testbed")
    except PackageNotFoundError:  # run from its source tree
        return "source"


@dataclass(frozen=True, kw_only=True)
class GMappingSettings:
    """Settings of the filter and of its final pass."""

    filter: FilterConfig = field(default_factory=FilterConfig)
    """Settings of the filter."""
    refine: bool = True
    """Whether all poses and the map are re-estimated after the last scan (final pass)."""
    threads: int | None = None
    """Threads; None = all cores. The result does not depend on it."""


class FilterSystem:
    """What the systems that are made of this package's filter share: the estimation over a recording."""

    name = "gmapping"
    version = own_version()

    def __init__(self, config: FilterConfig, *, refine: bool, threads: int | None) -> None:
        self._config, self._refine, self._threads = config, refine, threads
        self._known_map: KnownMap | None = None
        self._estimation: Estimation | None = None

    def start(self, lidars: Sequence[Lidar], seed: int) -> None:
        """Create the filter with the stream of random numbers that `testbed run` gives it."""
        stream = RunSeeds.from_seed(seed).filter
        self._estimation = Estimation(self._config, stream, self._threads, self._known_map)

    def process(self, frame: Frame) -> Pose | None:
        """Process a frame; the pose is that of the best particle."""
        assert self._estimation is not None
        report = self._estimation.process(frame)
        return None if report is None else report.pose

    def particles(self) -> tuple[Pose, NDArray[np.float64]] | None:
        """Return all particles; None where there is only one, and while a localisation has none."""
        assert self._estimation is not None
        mapper = self._estimation.mapper
        return (mapper.poses, mapper.weights) if len(mapper.poses) > 1 else None

    def finish(self) -> tuple[Trajectory | None, OccupancyGrid | None]:
        """Return poses at all frames and the map, after the final pass where that is wanted."""
        assert self._estimation is not None
        if not len(self._estimation.scan_frames):
            return None, None
        estimate = self._estimation.filtered()
        if self._refine:
            estimate = self._estimation.refined(estimate)
        return estimate.dense, estimate.map


class GMappingSystem(FilterSystem):
    """The particle filter of `slam.gmapping` and the final pass; the same bits as `testbed run` without --system."""

    def __init__(self, settings: GMappingSettings | None = None) -> None:
        self.settings = settings or GMappingSettings()
        super().__init__(self.settings.filter, refine=self.settings.refine, threads=self.settings.threads)


@dataclass(frozen=True, kw_only=True)
class ScanMatchingSettings:
    """Settings of the scan matcher: those of the filter, but for one particle that is put where its scan fits best."""

    filter: FilterConfig = field(default_factory=FilterConfig)
    """Settings of the filter."""
    threads: int | None = None
    """Threads; None = all cores. The result does not depend on it."""


class ScanMatchingSystem(FilterSystem):
    """The filter with one particle and without final pass: each scan is matched with the one map, which is kept."""

    name = "scan-matching"

    def __init__(self, settings: ScanMatchingSettings | None = None) -> None:
        chosen = settings or ScanMatchingSettings()
        proposal = replace(chosen.filter.proposal, kind="scan-match")
        adapt = replace(chosen.filter.adapt, count="fixed")
        single = replace(chosen.filter, particles=1, proposal=proposal, adapt=adapt)
        self.settings = replace(chosen, filter=single)
        super().__init__(single, refine=False, threads=chosen.threads)
