# SPDX-License-Identifier: MIT
"""Particles in a map that nobody changes: Algorithm 1 of T-RO 2007 without its map update, with as many particles as
their spread asks for (Fox 2003)."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config.filter import FilterConfig, LocalizationConfig
from slam.gmapping import StepReport
from slam.localization.fixed_map import FrozenMap
from slam.matching._likelihood_kernels import Evidence, MotionPrior, wall_distances
from slam.matching._proposal_kernels import Proposed
from slam.matching.proposal import beam_model, propose_poses, search_of
from slam.motion.odometry_model import motion_prior
from slam.particles.ancestry import Ancestry
from slam.particles.kld import bins_of, count_by_kld
from slam.particles.resampling import SCHEMES
from slam.particles.weights import Weights, pose_covariance
from slam.sensor.rays import Readings


class Rough(NamedTuple):
    """How far off poses may be."""

    position: float
    """Standard deviation in x and in y [m]."""
    heading: float
    """Standard deviation [rad]."""

    @property
    def prior(self) -> MotionPrior:
        """A Gaussian of these deviations, as both components of a motion prior."""
        sigma = np.array([self.position, self.position, self.heading])
        log_scale = -np.log(2.0) - np.log(sigma).sum() - 1.5 * np.log(2.0 * np.pi)
        return MotionPrior(precision=np.tile(sigma**-2.0, (2, 1)), log_scale=np.full(2, log_scale))

    @property
    def starts(self) -> NDArray[np.float64]:
        """Starting points of the matcher (n, 3) seen from the pose: up to two deviations, one apart."""
        steps = np.stack(np.meshgrid(*[np.arange(-2.0, 3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        return steps[np.any(steps != 0.0, axis=1)] * (self.position, self.position, self.heading)


class MapTracker:
    """Particles that are matched one by one; poses are seen from the grid's corner, as in `FrozenMap`."""

    def __init__(
        self,
        frozen: FrozenMap,
        config: FilterConfig,
        settings: LocalizationConfig,
        rng: np.random.Generator,
        *,
        poses: se2.Pose,
        rough: Rough,
    ) -> None:
        """Particles of equal weight at `poses` (n, 3), of which the first scan is to find out more."""
        self.config, self.settings = config, settings
        self.poses, self.weights = poses, Weights.uniform(len(poses))
        self.fit: float | None = None
        """Share of the hits that the map explains at the best pose, mean over the last updates; None before them."""
        self.places = 0
        """Places that hold `settings.sure` of the weight together."""
        self._frozen = frozen
        self._rng = rng
        self._rough: Rough | None = rough
        self._ancestry = Ancestry(len(poses))

    @property
    def judged(self) -> bool:
        """Whether there were enough updates to go by `fit`."""
        return 2 * self._ancestry.generations >= self.settings.fit_memory

    @property
    def lost(self) -> bool:
        """Whether the map explains too little of what the robot sees."""
        return self.judged and self.fit is not None and self.fit < self.settings.least_fit

    @property
    def found(self) -> bool:
        """Whether one place is left and the map explains what the robot sees there."""
        return self.judged and not self.lost and self.places == 1

    def path(self, particle: int | None = None) -> se2.Pose:
        """Path of a particle (default: the best): the mean of its proposal at each update, (updates, 3)."""
        return self._ancestry.path(self.weights.best if particle is None else particle)

    def take(self, motion: se2.Pose, hits: NDArray[np.float64], readings: Readings) -> StepReport:
        """Take in a scan with hits (K, 2) [m] in the robot's frame, after a displacement (3,) since the last one."""
        clock = [time.perf_counter()]
        proposed = self._propose(motion, hits)
        clock.append(time.perf_counter())

        self.poses = proposed.pose.copy()
        self.weights, evidence = self.weights.times(self.settings.weight_share * proposed.log_gain)
        self._ancestry.add(proposed.mean)

        ess, best, weights = self.weights.ess, self.weights.best, self.weights.values
        pose = proposed.mean[best].copy()
        covariance = pose_covariance(self.poses, weights, proposed.covariance)
        self._judge(pose, hits)
        resampled = self._resample(ess)
        clock.append(time.perf_counter())

        return StepReport(
            updated=True,
            pose=pose,
            covariance=covariance,
            particles=len(weights),
            ess=ess,
            readings=readings,
            resampled=resampled,
            matched_share=min(float(weights @ proposed.matched), 1.0),  # the weights' sum may round above 1
            match_failures=int(proposed.failed.sum()),
            log_evidence=evidence,
            unique_ancestors=self._ancestry.unique_ancestors,
            best=best,
            map_bytes=self._frozen.maps.bytes_in_use,
            seconds=dict(zip(("match", "resample"), np.diff(clock).tolist(), strict=True)),
            proposed=proposed,
        )

    def _propose(self, motion: se2.Pose, hits: NDArray[np.float64]) -> Proposed:
        """New poses of all particles; from a wide prior and many starting points where they are only roughly right."""
        cfg = self.config
        prior, search = motion_prior(motion, cfg.motion), search_of(motion, hits, cfg)
        if self._rough is not None:
            prior, search = self._rough.prior, search._replace(starts=self._rough.starts)
            self._rough = None
        evidence = Evidence(hits, beam_model(cfg.match, cfg.map), prior)
        guesses = se2.compose(self.poses, motion)
        return propose_poses(self._frozen.maps, guesses, evidence, search, cfg.proposal.samples, self._rng)

    def _judge(self, pose: se2.Pose, hits: NDArray[np.float64]) -> None:
        """Bring `fit` and `places` up to date, for the best pose (3,) and the hits (K, 2) of a scan."""
        distances = np.empty((4, len(hits)))
        wall_distances(self._frozen.maps.grids, 0, *pose, hits, self.config.map.field_radius, distances)
        explained = float(np.mean(np.hypot(distances[0], distances[1]) <= self.settings.near))
        gain = 1.0 / min(self._ancestry.generations, self.settings.fit_memory)
        self.fit = explained if self.fit is None else self.fit + gain * (explained - self.fit)
        self.places = self._count_places()

    def _count_places(self) -> int:
        """How many places are needed until they hold `sure` of the weight, the heaviest first."""
        s, weights = self.settings, self.weights.values
        count = 0
        while weights.sum() > 1.0 - s.sure:
            away = np.abs(self.poses - self.poses[np.argmax(weights)])
            here = (np.hypot(away[:, 0], away[:, 1]) < s.place_position) & (
                np.abs(se2.wrap_angle(away[:, 2])) < s.place_heading
            )
            weights = np.where(here, 0.0, weights)
            count += 1
        return count

    def _resample(self, ess: float) -> bool:
        """Draw the particles anew where the weights or the number of particles call for it."""
        policy, s, n = self.config.resample, self.settings, len(self.poses)
        if policy.when == "never":
            return False
        weights = self.weights.values
        needed = count_by_kld(
            bins_of(self.poses, s.place_position, s.place_heading),
            weights,
            self._rng,
            error=s.kld_error,
            quantile=s.kld_quantile,
            least=self.config.particles,
            most=max(s.most_candidates, self.config.particles),
        )
        if policy.when == "ess" and ess >= policy.threshold * n and 2 * needed > n:
            return False
        ancestors = SCHEMES[policy.scheme](weights, self._rng, min(needed, n))
        self.poses = self.poses[ancestors]
        self._ancestry.descend(ancestors)
        self.weights = Weights.uniform(len(ancestors))
        return True
