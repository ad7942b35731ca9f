# SPDX-License-Identifier: MIT
"""Rao-Blackwellized particle filter with improved proposals: Algorithm 1 of Grisetti, Stachniss, Burgard,
"Improved Techniques for Grid Mapping with Rao-Blackwellized Particle Filters", IEEE T-RO 23(1), 2007."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam._kernel_cache import announce_compilation
from slam._threads import Threads
from slam.config import FilterConfig
from slam.diagnosis.contradiction import ContradictionMonitor, ScanEvidence, SelfCheck
from slam.diagnosis.path_check import WheelStep, compare_scan
from slam.diagnosis.wheel_speed import WheelSpeed
from slam.grid.particle_maps import ParticleMaps
from slam.matching.likelihood import ScanAndPrior, make_beam_model
from slam.matching.proposal import ProposalResult, first_errors, propose_poses
from slam.matching.scan_matching import make_match_settings, shows_a_jump
from slam.motion.odometry_model import MotionPrior, motion_prior
from slam.occupancy import OccupancyGrid
from slam.particles.ancestry import Ancestry
from slam.particles.particle_count import next_count
from slam.particles.particle_set import ParticleSet
from slam.particles.resampling import SCHEMES, resampling_is_due
from slam.particles.weights import Weights
from slam.scan import Scan
from slam.step.loop_detector import LoopDetector
from slam.step.scan_intake import ScanIntake, TakenScan
from slam.step.step_report import StageClock, StepReport, report_state, report_update


class GMapping:
    """The filter: feed it odometry and scans in the order in which they were taken.

    The map's frame is the robot's pose at the first scan. Same settings, seed and input: the same bits, with any
    number of threads.
    """

    def __init__(
        self,
        config: FilterConfig | None = None,
        *,
        seed: int | np.random.SeedSequence = 0,
        threads: int | None = None,
    ) -> None:
        """Create a filter without a map; `threads` defaults to the cores of this machine."""
        announce_compilation(Path(__file__).parent)
        self.config = config or FilterConfig()
        self.maps = ParticleMaps(self.config.first_particles, self.config.map, Threads(threads))
        self._rng = np.random.default_rng(seed)
        self._intake = ScanIntake(self.config, first_needs_hits=False)
        self._particles = ParticleSet(np.zeros((self.config.first_particles, 3)))
        self._particles.errors = first_errors(
            self.config.first_particles, self.config.match.beam_weight, self._rng.bit_generator
        )
        self._loops = LoopDetector()
        self._monitor = ContradictionMonitor()
        self._wheels = WheelSpeed()
        self._matched = 0.0  # share of the hits near a wall at the last update, of the best particle

    def process(
        self, odometry: ArrayLike, scan: Scan | Sequence[Scan], *, twist: ArrayLike | None = None
    ) -> StepReport:
        """Process one scan, or the scans of several lidars at the same time.

        odometry: `T_odom_robot` (3,) at the first beam;  twist: velocity `(vx, vy, omega)` [m/s, m/s, rad/s] of the
        robot in its own frame while the scan was taken, to undo the motion where the beams' times are known; None =
        unknown, the motion within the scan then remains in it

        Raises:
            TypeError: `scan` is neither a `Scan` nor several of them.
            ValueError: the odometry or the twist is not three finite numbers, or the map would grow beyond all
                bounds; poses, weights and maps are then as they were before.
        """
        surprises = self._surprises if self.config.motion.jump_share > 0.0 else None
        taken = self._intake.take(odometry, scan, twist, surprises)
        self._wheels.update(taken.stamp, taken.odometry)
        if taken.rays is None:
            pose = se2.compose(self._particles.poses[self.best], taken.motion)
            report = report_state(self._particles, taken.counts, pose=pose, map_bytes=self.maps.bytes_in_use)
        else:
            report = self._begin(taken) if taken.first else self._update(taken)
            self._intake.accept(taken)
            self._wheels.begin_step()
        return replace(report, odometry_jumped=taken.jumped, self_check=self._monitor.present)

    def _begin(self, taken: TakenScan) -> StepReport:
        """Draw the first scan into the maps of all particles, which start at the origin."""
        assert taken.rays is not None
        particles, clock = self._particles, StageClock()
        self.maps.integrate_scan(particles.poses, taken.rays)
        start = particles.poses[0]
        self._loops.update(se2.transform_points(start, taken.hits), start, 0.0)
        clock.end_stage("map")
        particles.ancestry.add(particles.poses)
        pose, used = particles.poses[self.best].copy(), self.maps.bytes_in_use
        report = report_state(particles, taken.counts, pose=pose, map_bytes=used)
        return replace(report, updated=True, seconds={"match": 0.0, **clock.seconds, "resample": 0.0})

    def _update(self, taken: TakenScan) -> StepReport:
        """Run Algorithm 1 once."""
        assert taken.rays is not None
        particles, clock = self._particles, StageClock()
        before = particles.poses
        scan_and_prior = self._scan_and_prior(taken.motion, taken.hits)
        result = self._propose(taken, scan_and_prior)
        found = self._compare(taken, result, scan_and_prior.prior)
        clock.end_stage("match")

        self.maps.integrate_scan(result.pose, taken.rays)  # may refuse: before anything else has changed
        clock.end_stage("map")

        gain, poses = self.config.match.weight_share * result.log_gain, result.pose.copy()
        evidence = particles.move(poses, result.covariance, gain, history=poses)
        particles.errors = result.error
        pose, self._matched = poses[self.best].copy(), float(result.matched[self.best])
        moved = float(np.hypot(*(pose - before[self.best])[:2]))
        report = report_update(particles, result, taken.counts, pose=pose, evidence=evidence)
        self._monitor.update(taken.stamp, pose, found)
        resampled = self._resample(report)
        clock.end_stage("resample")

        loop = self._loops.update(se2.transform_points(pose, scan_and_prior.hits), pose, moved)
        return replace(
            report,
            resampled=resampled,
            beams=found.beams,
            unique_ancestors=self.ancestry.unique_ancestors,
            map_bytes=self.maps.bytes_in_use,
            loop_length=loop.length,
            loop_at_place=loop.at_place,
            loop_updates=loop.scans_ago,
            seconds=clock.seconds,
        )

    def _surprises(self, motion: se2.Pose, hits: NDArray[np.float64]) -> bool:
        """Whether a scan that the update gates leave out shows that the robot moved in another way than its wheels say.

        motion (3,) since the last used scan;  hits (K, 2) [m]
        """
        pose = se2.compose(self._particles.poses[self.best], motion)
        scan_and_prior = self._scan_and_prior(motion, np.ascontiguousarray(hits))
        return shows_a_jump(self.maps, self.best, pose, scan_and_prior, self._matched)

    def _scan_and_prior(self, motion: se2.Pose, hits: NDArray[np.float64]) -> ScanAndPrior:
        """By what new poses are judged after a displacement (3,), with the hits (K, 2) of a scan [m]."""
        cfg = self.config
        return ScanAndPrior(hits, make_beam_model(cfg.match, cfg.map), motion_prior(motion, cfg.motion))

    def _propose(self, taken: TakenScan, scan_and_prior: ScanAndPrior) -> ProposalResult:
        """Match, sample, fit, draw and weight for all particles: lines 4 to 21 of Algorithm 1."""
        cfg = self.config
        settings = make_match_settings(taken.motion, scan_and_prior.hits, cfg)
        guesses = se2.compose(self._particles.poses, taken.motion)
        weights, errors = self.weights, self._particles.errors
        return propose_poses(
            self.maps, guesses, scan_and_prior, settings, cfg, self._rng, weights=weights, errors=errors
        )

    def _compare(self, taken: TakenScan, result: ProposalResult, prior: MotionPrior) -> ScanEvidence:
        """What a scan that is not yet counted into the maps says of the estimate, by the best particle so far."""
        assert taken.rays is not None
        best = self.best
        step = WheelStep(taken.motion, prior, self._wheels.news)
        before, pose = self._particles.poses[best], result.pose[best]
        return compare_scan(self.maps, best, taken.rays, before=before, step=step, pose=pose)

    def _resample(self, report: StepReport) -> bool:
        """Resample where the effective sample size (equation 20) or the number of particles asks for it."""
        policy, n = self.config.resample, len(self._particles)
        count = next_count(n, report.covariance, self.config.adapt)
        if not resampling_is_due(policy, report.ess, n) and count == n:
            return False
        ancestors = SCHEMES[policy.scheme](self.weights, self._rng, count)
        self._particles.resample(ancestors)
        self.maps.inherit(ancestors)
        return True

    @property
    def ancestry(self) -> Ancestry:
        """Histories of all particles."""
        return self._particles.ancestry

    @property
    def poses(self) -> se2.Pose:
        """Poses of the particles at the last used scan, (particles, 3)."""
        return self._particles.poses.copy()

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weights of the particles, (particles,); they sum to 1."""
        return self._particles.weights.values

    @property
    def best(self) -> int:
        """Number of the most likely particle: that of the largest weight over its whole history."""
        return self._particles.best

    @property
    def self_check(self) -> SelfCheck:
        """The verdict on everything so far, by the filter's own evidence; `StepReport.self_check` is that of a scan."""
        return self._monitor.overall

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance (3, 3) of the pose in the map's frame: scatter of the particles plus that of their proposals."""
        return self._particles.covariance

    @property
    def scans(self) -> int:
        """Number of scans so far, used or not."""
        return self._intake.scans

    @property
    def update_scans(self) -> NDArray[np.int64]:
        """Numbers of the used scans, (updates,); the rows of a path belong to them."""
        return np.array(self._intake.update_scans, dtype=np.int64)

    def path(self, particle: int | None = None) -> se2.Pose:
        """Path of a particle (default: the best) through all updates, (updates, 3)."""
        return self.ancestry.path(self.best if particle is None else particle)

    def map(self, particle: int | None = None) -> OccupancyGrid:
        """Map of a particle (default: the best)."""
        return self.maps.occupancy(self.best if particle is None else particle)

    def __repr__(self) -> str:
        """One line, for notebooks."""
        x, y, theta = self.poses[self.best]
        used = f"{len(self.update_scans)} updates"
        return f"<GMapping: {len(self.weights)} particles, {used}, at ({x:.3f}, {y:.3f}, {theta:.3f})>"

    def state(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Everything that the filter remembers: named arrays, and plain values fit for JSON; nothing of it changes when
        the filter goes on."""
        arrays, values = self._intake.state()
        particles = {
            "poses": self._particles.poses.copy(),
            "log_weights": self._particles.weights.logs.copy(),
            "spread": self._particles.covariances.copy(),
            "errors": self._particles.errors.copy(),
            "log_histories": self._particles.log_histories.copy(),
        }
        arrays = {**particles, **arrays, **self.maps.state(), **self.ancestry.state()}
        own = {"rng": self._rng.bit_generator.state, "revisits": self._loops.state(), "matched": self._matched}
        own["self_check"], own["wheels"] = self._monitor.state(), self._wheels.state()
        return arrays, {**values, **own}

    def restore(self, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> None:
        """Take over what `state` gave, from a filter of the same settings. The arrays are copied: several filters may
        begin from one state."""
        self._particles = ParticleSet(np.array(arrays["poses"]))
        self._particles.weights = Weights(np.array(arrays["log_weights"]))
        self._particles.covariances = np.array(arrays["spread"])
        self._particles.errors = np.array(arrays["errors"])
        self._particles.log_histories = np.array(arrays["log_histories"])
        self.ancestry.restore(arrays)
        self._intake.restore(arrays, values)
        self.maps.restore(arrays)
        self._rng.bit_generator.state = values["rng"]
        self._loops.restore(values["revisits"])
        self._matched = values["matched"]
        self._monitor.restore(values["self_check"])
        self._wheels.restore(values["wheels"])
