# SPDX-License-Identifier: MIT
"""Where on the map is the robot? Monte Carlo localisation from everywhere, until few places are left.

Poses all over the free space are weighted by a wide beam end point model, moved by odometry and resampled (Thrun,
Burgard, Fox 2005, table 8.2), as many of them as KLD-sampling asks for. A pose need only come within reach of the
matcher; what is left goes to it.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config.filter import FilterConfig, LocalizationConfig
from slam.gmapping import StepReport
from slam.grid._distance_field_kernels import LARGEST_RADIUS
from slam.localization._search_kernels import score_poses
from slam.localization.fixed_map import FrozenMap, free_cells, maps_of_walls, wall_faces
from slam.matching._likelihood_kernels import BeamModel
from slam.motion.odometry_model import motion_prior
from slam.particles.kld import bins_of, count_by_kld
from slam.particles.resampling import systematic
from slam.particles.weights import Weights, pose_covariance
from slam.sensor.rays import Readings


class GlobalSearch:
    """Particles that do not know where they are; poses are seen from the grid's corner, as in `FrozenMap`."""

    def __init__(
        self, frozen: FrozenMap, config: FilterConfig, settings: LocalizationConfig, rng: np.random.Generator
    ) -> None:
        """A search that has seen nothing yet."""
        self.config, self.settings = config, settings
        self.poses: se2.Pose = np.empty((0, 3))
        """The particles after the last scan, (n, 3)."""
        self._rng = rng
        self._frozen = frozen
        self._grid = frozen.grid
        cell = self._grid.resolution
        self._radius = min(settings.search_radius, LARGEST_RADIUS * cell)
        wide = replace(config.map, cell=cell, field_radius=self._radius)
        self._maps = maps_of_walls(wall_faces(self._grid), wide, frozen.maps.threads)

    @property
    def settled(self) -> bool:
        """Whether so few particles are left that each can be matched."""
        return 0 < len(self.poses) <= self.settings.most_candidates

    @property
    def weights(self) -> Weights:
        """Equal ones: the particles are drawn anew after each scan."""
        return Weights.uniform(max(len(self.poses), 1))

    def take(self, motion: se2.Pose, hits: NDArray[np.float64], readings: Readings) -> StepReport:
        """Take in a scan with hits (K, 2) [m] in the robot's frame, after a displacement (3,) since the last one."""
        started = time.perf_counter()
        first = len(self.poses) == 0
        poses = self._spread() if first else self._moved(motion)
        weights, evidence = Weights.uniform(len(poses)).times(self._log_likelihood(poses, hits))
        chosen = poses[self._offspring(poses, weights.values)]
        if first:  # several particles may stand for one pose: they share its surroundings
            s = self.settings
            within = np.array([s.spread_position, s.spread_position, s.spread_heading])
            chosen = chosen + self._rng.uniform(-0.5, 0.5, chosen.shape) * within
        self.poses = chosen
        return StepReport(
            updated=True,
            pose=poses[weights.best],
            covariance=pose_covariance(chosen, self.weights.values, np.zeros((len(chosen), 3, 3))),
            particles=len(poses),
            ess=weights.ess,
            readings=readings,
            resampled=True,
            log_evidence=evidence,
            unique_ancestors=len(chosen),
            map_bytes=self._frozen.maps.bytes_in_use + self._maps.bytes_in_use,
            seconds={"match": time.perf_counter() - started},
        )

    def _spread(self) -> se2.Pose:
        """Poses all over the free space (n, 3): one at random in each cell of a coarse lattice in x, y and heading."""
        s, rng = self.settings, self._rng
        free = free_cells(self._grid)
        free = free[rng.permutation(len(free))]
        squares = np.floor(free / s.spread_position).astype(np.int64)
        points = free[np.unique(squares, axis=0, return_index=True)[1]]
        turns = max(1, round(2.0 * np.pi / s.spread_heading))
        headings = (np.arange(turns) + rng.uniform(size=(len(points), 1))) * (2.0 * np.pi / turns)
        return np.column_stack([np.repeat(points, turns, axis=0), se2.wrap_angle(headings.ravel())])

    def _moved(self, motion: se2.Pose) -> se2.Pose:
        """The particles, each after a draw from the motion model."""
        prior, n = motion_prior(motion, self.config.motion), len(self.poses)
        sigma = prior.precision**-0.5
        failed = self._rng.uniform(size=n) < self.config.motion.failure_share
        error = self._rng.standard_normal((n, 3)) * sigma[failed.astype(np.int64)]
        return se2.compose(se2.compose(self.poses, motion), error)

    def _log_likelihood(self, poses: se2.Pose, hits: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of some of the hits, evenly chosen, at each pose, (n,) [nats]."""
        s = self.settings
        few = np.ascontiguousarray(hits[:: max(1, len(hits) // s.search_beams)])
        model = BeamModel(
            per_sigma2=s.search_sigma**-2.0,
            per_outlier2=self._radius**-2.0,
            weight=min(s.independent_beams / len(few), 1.0),
            far=self._radius,
        )
        logs = np.empty(len(poses))
        self._maps.threads.run(score_poses, len(poses), self._maps.grids, poses, few, model, logs)
        return logs

    def _offspring(self, poses: se2.Pose, weights: NDArray[np.float64]) -> NDArray[np.int64]:
        """Ancestors of the next particles, as many as KLD-sampling asks for."""
        s = self.settings
        count = count_by_kld(
            bins_of(poses, s.place_position, s.place_heading),
            weights,
            self._rng,
            error=s.kld_error,
            quantile=s.kld_quantile,
            least=self.config.particles,
            most=max(s.most_poses, self.config.particles),
        )
        return systematic(weights, self._rng, count)
