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
from slam.config import FilterConfig, LocalizationConfig
from slam.grid.distance_field import MAX_RADIUS
from slam.grid.wall_maps import maps_of_walls
from slam.localization.fixed_map import FixedMap, free_lattice, wall_faces
from slam.matching.likelihood import BeamModel, log_likelihoods
from slam.motion.odometry_model import sample_motion
from slam.particles.kld import bins_of, count_by_kld
from slam.particles.resampling import systematic
from slam.particles.weights import Weights, pose_covariance
from slam.step.scan_intake import TakenScan
from slam.step.step_report import StepReport


class GlobalSearch:
    """Particles anywhere in the free space; poses are seen from the grid's corner, as in `FixedMap`."""

    def __init__(
        self, fixed: FixedMap, config: FilterConfig, settings: LocalizationConfig, rng: np.random.Generator
    ) -> None:
        """Prepare a search; the first scan starts it."""
        self.config, self.settings = config, settings
        self.poses: se2.Pose = np.empty((0, 3))
        """The particles after the last scan, (n, 3)."""
        self._rng = rng
        self._fixed = fixed
        self._grid = fixed.grid
        cell = self._grid.resolution
        self._radius = min(settings.search_radius, MAX_RADIUS * cell)
        wide = replace(config.map, cell=cell, field_radius=self._radius)
        self._maps = maps_of_walls(wall_faces(self._grid), wide, fixed.maps.threads)

    @property
    def settled(self) -> bool:
        """Whether so few particles are left that each can be matched."""
        return 0 < len(self.poses) <= self.settings.max_candidates

    @property
    def weights(self) -> Weights:
        """Equal weights: the particles are resampled after each scan."""
        return Weights.uniform(max(len(self.poses), 1))

    def update(self, taken: TakenScan) -> StepReport:
        """Move, weight and resample all particles once."""
        started = time.perf_counter()
        first = len(self.poses) == 0
        poses = (
            self._initial_poses() if first else sample_motion(self.poses, taken.motion, self.config.motion, self._rng)
        )
        weights, evidence = Weights.uniform(len(poses)).times(self._log_likelihood(poses, taken.hits))
        chosen = poses[self._offspring(poses, weights.values)]
        if first:  # several particles may have drawn one pose: they are scattered over its cell of the lattice
            s = self.settings
            within = np.array([s.search_spacing, s.search_spacing, s.search_spacing_heading])
            chosen = chosen + self._rng.uniform(-0.5, 0.5, chosen.shape) * within
        self.poses = chosen
        return StepReport(
            updated=True,
            pose=poses[np.argmax(weights.logs)],
            covariance=pose_covariance(chosen, self.weights.values, np.zeros((len(chosen), 3, 3))),
            particles=len(poses),
            ess=weights.ess,
            readings=taken.counts,
            resampled=True,
            log_evidence=evidence,
            unique_ancestors=len(chosen),
            map_bytes=self._fixed.maps.bytes_in_use + self._maps.bytes_in_use,
            seconds={"match": time.perf_counter() - started},
        )

    def _initial_poses(self) -> se2.Pose:
        """Poses all over the free space (n, 3): a random one in each cell of a coarse lattice in x, y and heading."""
        s, rng = self.settings, self._rng
        points = free_lattice(self._grid, s.search_spacing, rng)
        turns = max(1, round(2.0 * np.pi / s.search_spacing_heading))
        headings = (np.arange(turns) + rng.uniform(size=(len(points), 1))) * (2.0 * np.pi / turns)
        poses = np.empty((len(points), turns, 3))  # filled in place: there are millions on large maps
        poses[:, :, :2] = points[:, None]
        poses[:, :, 2] = se2.wrap_angle(headings)
        return poses.reshape(-1, 3)

    def _log_likelihood(self, poses: se2.Pose, hits: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log-likelihood of every k-th hit at each pose, (n,) [nats]."""
        s = self.settings
        every_kth = np.ascontiguousarray(hits[:: max(1, len(hits) // s.search_beams)])
        model = BeamModel(
            per_sigma2=s.search_sigma**-2.0,
            per_outlier2=self._radius**-2.0,
            weight=min(s.independent_beams / len(every_kth), 1.0),
            far=self._radius,
        )
        return log_likelihoods(self._maps, poses, every_kth, model)

    def _offspring(self, poses: se2.Pose, weights: NDArray[np.float64]) -> NDArray[np.int64]:
        """Ancestors of the next particles; KLD-sampling gives their number."""
        s = self.settings
        count = count_by_kld(
            bins_of(poses, s.cluster_position, s.cluster_heading),
            weights,
            self._rng,
            error=s.kld_error,
            quantile=s.kld_quantile,
            least=self.config.particles,
            most=max(s.max_search_poses, self.config.particles),
        )
        return systematic(weights, self._rng, count)
