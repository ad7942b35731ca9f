# SPDX-License-Identifier: MIT
"""Localisation in a finished map: the filter of `slam.gmapping` with its map frozen, from a known or an unknown start.

A known start is tracked (`slam.localization.pose_tracker`); an unknown one is looked for first (`slam.localization.global_search`), and so is one
that was lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam._threads import Threads
from slam.config.filter import FilterConfig, LocalizationConfig
from slam.gmapping import StepReport
from slam.localization.fixed_map import FrozenMap, checked_start, free_cells
from slam.localization.global_search import GlobalSearch
from slam.localization.pose_tracker import MapTracker, Rough
from slam.motion.odometry_model import checked_odometry
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.sensor.rays import Readings, rays_of, readings_of

State = Literal["searching", "ambiguous", "found"]


@dataclass(frozen=True)
class Whereabouts:
    """What a localisation knows of itself."""

    state: State
    """searching: the robot may be nearly anywhere; ambiguous: several places explain the scans alike, or too few scans
    have told of the one; found: one place explains them."""
    places: int
    """Places that hold the weight of the particles together; 0 while searching."""
    fit: float | None
    """Share of the hits that the map explains at the best pose, mean over the last updates; None before them."""
    found_at: tuple[int, ...]
    """Numbers of the scans at which the robot was found, after the start and after each loss."""
    lost_at: tuple[int, ...]
    """Numbers of the scans at which the map no longer explained what the robot saw, and the search began anew."""


class Localization:
    """A filter that tracks the robot in a map: feed it odometry and scans as they were taken, as a mapper.

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
        """Localise in `grid`, from about `start` (3,) [m, m, rad] in the map's frame, or from anywhere.

        Raises:
            ValueError: the map has no walls or no free space, or the start is not on it.
        """
        self.config, self.settings = config or FilterConfig(), settings or LocalizationConfig()
        self._rng = np.random.default_rng(seed)
        self._frozen = FrozenMap(grid, self.config.map, Threads(threads))
        self._belief = self._from_anywhere() if start is None else self._from_start(start)
        self._report = self._prior_report()
        self._odometry: se2.Pose | None = None  # at the last scan that was taken in
        self._stamp = 0.0
        self._scans = 0
        self._tracked: list[int] = []  # scans that the tracker at hand has taken in
        self._past: list[tuple[list[int], se2.Pose]] = []  # scans and poses in the grid's frame of former trackers
        self._found_at: list[int] = []
        self._lost_at: list[int] = []

    def _from_anywhere(self) -> GlobalSearch:
        return GlobalSearch(self._frozen, self.config, self.settings, self._rng)

    def _from_start(self, start: ArrayLike) -> MapTracker:
        """Particles at a start in the map's frame (3,)."""
        rough = Rough(self.settings.start_position, self.settings.start_heading)
        pose = checked_start(start, self._frozen.grid, 2.0 * rough.position)
        local = se2.between(self._frozen.T_map_grid, pose)
        return self._tracker(np.tile(local, (self.config.particles, 1)), rough)

    def _tracker(self, poses: se2.Pose, rough: Rough) -> MapTracker:
        return MapTracker(self._frozen, self.config, self.settings, self._rng, poses=poses, rough=rough)

    def _prior_report(self) -> StepReport:
        """What is known before the first scan: the start, or that the robot is somewhere in the free space."""
        if isinstance(self._belief, MapTracker):
            rough = Rough(self.settings.start_position, self.settings.start_heading)
            pose, variances = self._belief.poses[0], np.square([rough.position, rough.position, rough.heading])
            covariance = np.diag(variances)
        else:
            free = free_cells(self._frozen.grid)
            pose, covariance = np.append(free.mean(axis=0), 0.0), np.zeros((3, 3))
            covariance[:2, :2] = np.cov(free.T, ddof=0)
            covariance[2, 2] = np.pi**2 / 3.0
        nothing = Readings(0, 0, 0)
        return self._in_map(
            StepReport(updated=False, pose=pose, covariance=covariance, particles=1, ess=1.0, readings=nothing)
        )

    def process(
        self, odometry: ArrayLike, scan: Scan | Sequence[Scan], *, twist: ArrayLike | None = None
    ) -> StepReport:
        """Take in one scan, or the scans of several lidars at the same time; as `GMapping.process`.

        Raises:
            ValueError: the odometry or the twist is not three finite numbers.
        """
        now = checked_odometry(odometry, twist)
        scans = [scan] if isinstance(scan, Scan) else list(scan)
        readings = readings_of(scans)
        self._scans += 1
        first = self._odometry is None
        motion = np.zeros(3) if self._odometry is None else se2.between(self._odometry, now)
        if not first and not self.config.gate.opens(motion, scans[0].stamp - self._stamp):
            return self._report_between(motion, readings)
        rays = rays_of(scans, usable_range=self.config.map.usable_range, twist=twist if self.config.deskew else None)
        hits = np.ascontiguousarray(rays.ends[rays.hit])
        if len(hits) == 0:
            return self._report_between(motion, readings)  # a scan that saw nothing tells nothing
        self._report = self._in_map(self._take(motion, hits, readings))
        self._odometry, self._stamp = now, scans[0].stamp
        return self._report

    def _report_between(self, motion: se2.Pose, readings: Readings) -> StepReport:
        """The state carried on by odometry, for a scan that is not taken in."""
        last = self._report
        return StepReport(
            updated=False,
            pose=se2.compose(last.pose, motion),
            covariance=last.covariance,
            particles=last.particles,
            ess=last.ess,
            readings=readings,
            unique_ancestors=last.unique_ancestors,
            best=last.best,
            map_bytes=last.map_bytes,
        )

    def _take(self, motion: se2.Pose, hits: NDArray[np.float64], readings: Readings) -> StepReport:
        """Take a scan in; go from searching to tracking, and back where the robot is lost."""
        belief, number = self._belief, self._scans - 1
        report = belief.take(motion, hits, readings)
        if isinstance(belief, GlobalSearch):
            if belief.settled:
                rough = Rough(0.5 * self.settings.spread_position, 0.5 * self.settings.spread_heading)
                self._belief, self._tracked = self._tracker(belief.poses, rough), []
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
    def whereabouts(self) -> Whereabouts:
        """What is known of where the robot is."""
        belief, history = self._belief, (tuple(self._found_at), tuple(self._lost_at))
        if isinstance(belief, GlobalSearch):
            return Whereabouts("searching", 0, None, *history)
        return Whereabouts("found" if belief.found else "ambiguous", belief.places, belief.fit, *history)

    @property
    def poses(self) -> se2.Pose:
        """Poses of the particles after the last scan that was taken in, (particles, 3); their number changes."""
        return se2.compose(self._frozen.T_map_grid, self._belief.poses)

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weights of the particles, (particles,); they sum to 1."""
        return self._belief.weights.values

    @property
    def update_scans(self) -> NDArray[np.int64]:
        """Numbers of the scans whose poses `path` gives, (updates,); at least one after the first scan."""
        return np.array(self._history()[0], dtype=np.int64)

    def path(self, particle: int | None = None) -> se2.Pose:
        """Path of a particle (default: the best) through all scans at which the robot was tracked, (updates, 3)."""
        return self._history(particle)[1]

    def map(self, particle: int | None = None) -> OccupancyGrid:
        """The map, as it was given: all particles have the same."""
        return self._frozen.grid

    def _history(self, particle: int | None = None) -> tuple[list[int], se2.Pose]:
        """Scans and poses in the map's frame of all trackers; where there was none, what is known at the last scan."""
        parts = list(self._past)
        if isinstance(self._belief, MapTracker) and self._tracked:
            parts.append((self._tracked, self._belief.path(particle)))
        if not parts:
            return [max(self._scans - 1, 0)], self._report.pose[None]
        scans = [number for numbers, _ in parts for number in numbers]
        return scans, se2.compose(self._frozen.T_map_grid, np.concatenate([poses for _, poses in parts]))

    def _in_map(self, report: StepReport) -> StepReport:
        """A report seen from the grid's corner, in the map's frame."""
        T_map_grid, proposed = self._frozen.T_map_grid, report.proposed
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
