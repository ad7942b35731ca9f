# SPDX-License-Identifier: MIT
"""Pose tracking in a fixed map: Algorithm 1 of T-RO 2007 without its map update, with a particle number that follows
the belief (Fox 2003)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config import FilterConfig, LocalizationConfig
from slam.localization.fixed_map import FixedMap
from slam.matching.likelihood import ScanAndPrior, distances_to_walls, make_beam_model
from slam.matching.proposal import ProposalResult, propose_poses
from slam.matching.scan_matching import make_match_settings
from slam.motion.odometry_model import MotionPrior, motion_prior
from slam.particles.kld import bins_of, count_by_kld
from slam.particles.particle_set import ParticleSet
from slam.particles.resampling import SCHEMES, resampling_is_due
from slam.particles.weights import Weights
from slam.step.scan_intake import TakenScan
from slam.step.step_report import StageClock, StepReport, report_update


class PoseUncertainty(NamedTuple):
    """Standard deviations of a pose that is known approximately."""

    position: float
    """Standard deviation in x and in y [m]."""
    heading: float
    """Standard deviation of the heading [rad]."""

    @property
    def prior(self) -> MotionPrior:
        """Motion prior of which all components are one Gaussian with these deviations."""
        sigma = np.array([self.position, self.position, self.heading])
        log_scale = -np.log(3.0) - np.log(sigma).sum() - 1.5 * np.log(2.0 * np.pi)
        return MotionPrior(np.tile(sigma**-2.0, (3, 1)), np.full(3, log_scale), np.full(3, 1.0 / 3.0))

    @property
    def starts(self) -> NDArray[np.float64]:
        """Starting points of the matcher (n, 3) seen from the pose: a lattice of one deviation, two to each side."""
        steps = np.stack(np.meshgrid(*[np.arange(-2.0, 3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        return steps[np.any(steps != 0.0, axis=1)] * (self.position, self.position, self.heading)


class PoseTracker:
    """Particles that are matched one by one; poses are seen from the grid's corner, as in `FixedMap`."""

    def __init__(
        self,
        fixed: FixedMap,
        config: FilterConfig,
        settings: LocalizationConfig,
        rng: np.random.Generator,
        *,
        poses: se2.Pose,
        uncertainty: PoseUncertainty,
    ) -> None:
        """Start particles of equal weight at `poses` (n, 3), which the first scan corrects within their uncertainty."""
        self.config, self.settings = config, settings
        self.explained_share: float | None = None
        """Share of the hits that the map explains at the best pose, mean over the last updates; None before them."""
        self.clusters = 0
        """Number of clusters of particles that hold `settings.found_weight` of the weight together."""
        self._fixed = fixed
        self._rng = rng
        self._uncertainty: PoseUncertainty | None = uncertainty
        self._particles = ParticleSet(poses)

    @property
    def poses(self) -> se2.Pose:
        """Poses of the particles after the last scan, (n, 3)."""
        return self._particles.poses

    @property
    def weights(self) -> Weights:
        """Weights of the particles after the last scan."""
        return self._particles.weights

    @property
    def judged(self) -> bool:
        """Whether there were enough updates to rely on `explained_share`."""
        return 2 * self._particles.ancestry.generations >= self.settings.explained_memory

    @property
    def lost(self) -> bool:
        """Whether the map explains too little of what the robot sees."""
        share = self.explained_share
        return self.judged and share is not None and share < self.settings.min_explained_share

    @property
    def found(self) -> bool:
        """Whether one cluster is left and the map explains what the robot sees there."""
        return self.judged and not self.lost and self.clusters == 1

    def path(self, particle: int | None = None) -> se2.Pose:
        """Path of a particle (default: the best): the mean of its proposal at each update, (updates, 3)."""
        return self._particles.ancestry.path(self._particles.best if particle is None else particle)

    def update(self, taken: TakenScan) -> StepReport:
        """Run Algorithm 1 once, the map update left out."""
        particles, clock = self._particles, StageClock()
        result = self._propose(taken)
        clock.end_stage("match")

        gain = self.settings.weight_share * result.log_gain
        evidence = particles.move(result.pose.copy(), result.covariance, gain, history=result.mean)
        pose = result.mean[particles.best].copy()
        report = report_update(particles, result, taken.counts, pose=pose, evidence=evidence)
        self._judge(pose, taken.hits)
        resampled = self._resample(report.ess)
        clock.end_stage("resample")

        return replace(
            report,
            resampled=resampled,
            unique_ancestors=particles.ancestry.unique_ancestors,
            map_bytes=self._fixed.maps.bytes_in_use,
            seconds=clock.seconds,
        )

    def _propose(self, taken: TakenScan) -> ProposalResult:
        """New poses of all particles; a wide prior and many starting points where poses are known approximately."""
        cfg, motion, hits = self.config, taken.motion, taken.hits
        prior, settings = motion_prior(motion, cfg.motion), make_match_settings(motion, hits, cfg)
        if self._uncertainty is not None:
            prior, settings = self._uncertainty.prior, settings._replace(starts=self._uncertainty.starts)
            self._uncertainty = None
        scan_and_prior = ScanAndPrior(hits, make_beam_model(cfg.match, cfg.map), prior)
        guesses = se2.compose(self.poses, motion)
        maps, weights = self._fixed.maps, self.weights.values
        return propose_poses(maps, guesses, scan_and_prior, settings, cfg, self._rng, weights=weights)

    def _judge(self, pose: se2.Pose, hits: NDArray[np.float64]) -> None:
        """Update `explained_share` and `clusters`, for the best pose (3,) and the hits (K, 2) of a scan."""
        distances = distances_to_walls(self._fixed.maps, pose, hits)
        explained = float(np.mean(distances <= self.settings.explained_distance))
        gain = 1.0 / min(self._particles.ancestry.generations, self.settings.explained_memory)
        before = self.explained_share
        self.explained_share = explained if before is None else before + gain * (explained - before)
        self.clusters = self._count_clusters()

    def _count_clusters(self) -> int:
        """How many clusters, the heaviest first, are needed to hold `found_weight` of the weight."""
        s, weights = self.settings, self.weights.values
        count = 0
        while weights.sum() > 1.0 - s.found_weight:
            away = np.abs(self.poses - self.poses[np.argmax(weights)])
            here = (np.hypot(away[:, 0], away[:, 1]) < s.cluster_position) & (
                np.abs(se2.wrap_angle(away[:, 2])) < s.cluster_heading
            )
            weights = np.where(here, 0.0, weights)
            count += 1
        return count

    def _resample(self, ess: float) -> bool:
        """Resample where the weights or the number of particles ask for it."""
        policy, s, n = self.config.resample, self.settings, len(self._particles)
        if policy.when == "never":
            return False
        weights = self.weights.values
        needed = count_by_kld(
            bins_of(self.poses, s.cluster_position, s.cluster_heading),
            weights,
            self._rng,
            error=s.kld_error,
            quantile=s.kld_quantile,
            least=self.config.particles,
            most=max(s.max_candidates, self.config.particles),
        )
        if not resampling_is_due(policy, ess, n) and 2 * needed > n:
            return False
        self._particles.resample(SCHEMES[policy.scheme](weights, self._rng, min(needed, n)))
        return True
