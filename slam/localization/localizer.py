# SPDX-License-Identifier: MIT
"""Localisation in a finished map: the filter of `slam.gmapping` with a fixed map, from a known or an unknown start.

A known start is tracked (`slam.localization.pose_tracker`). An unknown one is searched first
(`slam.localization.global_search`), and so is a robot that got lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam._threads import Threads
from slam.config import FilterConfig, LocalizationConfig
from slam.localization.fixed_map import FixedMap, checked_start, free_space_moments
from slam.localization.global_search import GlobalSearch
from slam.localization.pose_tracker import PoseTracker, PoseUncertainty
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.sensor.rays import BeamCounts
from slam.step.scan_intake import ScanIntake, TakenScan
from slam.step.step_report import StepReport

State = Literal["searching", "ambiguous", "found"]


@dataclass(frozen=True)
class LocalizationStatus:
    """Whether the robot is found, and how sure that is."""

    state: State
    """searching: the robot may be nearly anywhere; ambiguous: several places explain the scans equally well, or there
    were too few scans to judge the one; found: one place explains them."""
    clusters: int
    """Number of clusters that hold the weight of the particles; 0 while searching."""
    explained_share: float | None
    """Share of the hits that the map explains at the best pose, mean over the last updates; None before them."""
    found_at: tuple[int, ...]
    """Numbers of the scans at which the robot was found, after the start and after each loss."""
    lost_at: tuple[int, ...]
    """Numbers of the scans at which the map no longer explained what the robot saw, and the search started again."""


class Localization:
    """A filter that tracks the robot in a map: feed it odometry and scans in the order in which they were taken.

    All poses are in the map's frame. Same map, settings, seed and input: the same bits, with any number of threads.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        config: FilterConfig | None = None,
        settings: LocalizationConfig | None = None,
        *,
        start: ArrayLike | None = None,
        seed: int | np.random.SeedSequence = 0,
        threads: int | None = None,
    ) -> None:
        """Localise in `grid`, from approximately `start` (3,) [m, m, rad] in the map's frame, or from anywhere.

        Raises:
            ValueError: the map has no walls or no free space, or the start is not on it.
        """
        self.config, self.settings = config or FilterConfig(), settings or LocalizationConfig()
        self._rng = np.random.default_rng(seed)
        self._fixed = FixedMap(grid, self.config.map, Threads(threads))
        self._belief = self._from_anywhere() if start is None else self._from_start(start)
        self._report = self._prior_report()
        self._intake = ScanIntake(self.config, first_needs_hits=True)
        self._tracked: list[int] = []  # scans that the present tracker has used
        self._past: list[tuple[list[int], se2.Pose]] = []  # scans and poses in the grid's frame of former trackers
        self._found_at: list[int] = []
        self._lost_at: list[int] = []

    def _from_anywhere(self) -> GlobalSearch:
        return GlobalSearch(self._fixed, self.config, self.settings, self._rng)

    def _from_start(self, start: ArrayLike) -> PoseTracker:
        """Particles at a start in the map's frame (3,)."""
        uncertainty = PoseUncertainty(self.settings.start_position, self.settings.start_heading)
        pose = checked_start(start, self._fixed.grid, 2.0 * uncertainty.position)
        local = se2.between(self._fixed.T_map_grid, pose)
        return self._tracker(np.tile(local, (self.config.particles, 1)), uncertainty)

    def _tracker(self, poses: se2.Pose, uncertainty: PoseUncertainty) -> PoseTracker:
        return PoseTracker(self._fixed, self.config, self.settings, self._rng, poses=poses, uncertainty=uncertainty)

    def _prior_report(self) -> StepReport:
        """What is known before the first scan: the start, or that the robot is somewhere in the free space."""
        if isinstance(self._belief, PoseTracker):
            uncertainty = PoseUncertainty(self.settings.start_position, self.settings.start_heading)
            pose, variances = (
                self._belief.poses[0],
                np.square([uncertainty.position, uncertainty.position, uncertainty.heading]),
            )
            covariance = np.diag(variances)
        else:
            mean, spread = free_space_moments(self._fixed.grid)
            pose, covariance = np.append(mean, 0.0), np.zeros((3, 3))
            covariance[:2, :2] = spread
            covariance[2, 2] = np.pi**2 / 3.0
        nothing = BeamCounts(0, 0, 0)
        return self._in_map(
            StepReport(updated=False, pose=pose, covariance=covariance, particles=1, ess=1.0, readings=nothing)
        )

    def process(
        self, odometry: ArrayLike, scan: Scan | Sequence[Scan], *, twist: ArrayLike | None = None
    ) -> StepReport:
        """Process one scan, or the scans of several lidars at the same time; as `GMapping.process`.

        Raises:
            ValueError: the odometry or the twist is not three finite numbers.
        """
        taken = self._intake.take(odometry, scan, twist)
        if taken.rays is None:
            return replace(self._report_between(taken), odometry_jumped=taken.jumped)
        self._report = self._in_map(self._update(taken))
        self._intake.accept(taken)
        return replace(self._report, odometry_jumped=taken.jumped)

    def _report_between(self, taken: TakenScan) -> StepReport:
        """The last state, moved on by odometry, for a scan that is not used."""
        last = self._report
        return StepReport(
            updated=False,
            pose=se2.compose(last.pose, taken.motion),
            covariance=last.covariance,
            particles=last.particles,
            ess=last.ess,
            readings=taken.counts,
            unique_ancestors=last.unique_ancestors,
            best=last.best,
            map_bytes=last.map_bytes,
        )

    def _update(self, taken: TakenScan) -> StepReport:
        """Use a scan; go from searching to tracking, and back where the robot is lost."""
        belief, number = self._belief, self._intake.scans - 1
        report = belief.update(taken)
        if isinstance(belief, GlobalSearch):
            if belief.settled:
                uncertainty = PoseUncertainty(
                    0.5 * self.settings.search_spacing, 0.5 * self.settings.search_spacing_heading
                )
                self._belief, self._tracked = self._tracker(belief.poses, uncertainty), []
            return report
        self._tracked.append(number)
        if belief.lost:
            if self._was_found:
                self._past.append((self._tracked, belief.path()))
            self._lost_at.append(number)
            self._belief, self._tracked = self._from_anywhere(), []
        elif belief.found and not self._was_found:
            self._found_at.append(number)
        return report

    @property
    def _was_found(self) -> bool:
        """Whether the robot was found since the start or the last loss."""
        return len(self._found_at) > 0 and (not self._lost_at or self._found_at[-1] > self._lost_at[-1])

    @property
    def status(self) -> LocalizationStatus:
        """Whether the robot is found, and how sure that is."""
        belief, history = self._belief, (tuple(self._found_at), tuple(self._lost_at))
        if isinstance(belief, GlobalSearch):
            return LocalizationStatus("searching", 0, None, *history)
        return LocalizationStatus(
            "found" if belief.found else "ambiguous", belief.clusters, belief.explained_share, *history
        )

    @property
    def poses(self) -> se2.Pose:
        """Poses of the particles after the last used scan, (particles, 3); their number changes."""
        return se2.compose(self._fixed.T_map_grid, self._belief.poses)

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weights of the particles, (particles,); they sum to 1. A search that begins has no particles and none."""
        return self._belief.weights.values[: len(self._belief.poses)]

    @property
    def update_scans(self) -> NDArray[np.int64]:
        """Numbers of the scans whose poses `path` gives, (updates,); at least one after the first scan."""
        return np.array(self._history()[0], dtype=np.int64)

    def path(self, particle: int | None = None) -> se2.Pose:
        """Path of a particle (default: the best) through the scans at which the robot was tracked, (updates, 3)."""
        return self._history(particle)[1]

    def map(self, particle: int | None = None) -> OccupancyGrid:
        """The map as it was given; all particles share it."""
        return self._fixed.grid

    def _history(self, particle: int | None = None) -> tuple[list[int], se2.Pose]:
        """Scans and poses in the map's frame of all trackers; without any, the pose reported at the last scan."""
        parts = list(self._past)
        if isinstance(self._belief, PoseTracker) and self._tracked:
            parts.append((self._tracked, self._belief.path(particle)))
        if not parts:
            return [max(self._intake.scans - 1, 0)], self._report.pose[None]
        scans = [number for numbers, _ in parts for number in numbers]
        return scans, se2.compose(self._fixed.T_map_grid, np.concatenate([poses for _, poses in parts]))

    def _in_map(self, report: StepReport) -> StepReport:
        """Transform a report from the grid's frame to the map's."""
        T_map_grid, proposed = self._fixed.T_map_grid, report.proposed
        cos, sin = np.cos(T_map_grid[2]), np.sin(T_map_grid[2])
        turn = np.array([(cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)])
        if proposed is not None:
            proposed = proposed._replace(
                pose=se2.compose(T_map_grid, proposed.pose),
                mean=se2.compose(T_map_grid, proposed.mean),
                covariance=turn @ proposed.covariance @ turn.T,
                samples=se2.compose(T_map_grid, proposed.samples),
            )
        return replace(
            report,
            pose=se2.compose(T_map_grid, report.pose),
            covariance=turn @ report.covariance @ turn.T,
            proposed=proposed,
        )
