# SPDX-License-Identifier: MIT
"""Rao-Blackwellized particle filter with improved proposals: Algorithm 1 of Grisetti, Stachniss, Burgard,
"Improved Techniques for Grid Mapping with Rao-Blackwellized Particle Filters", IEEE T-RO 23(1), 2007."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam._threads import Threads
from slam.config.filter import FilterConfig
from slam.grid._traversal_kernels import Rays
from slam.grid.particle_maps import ParticleMaps
from slam.matching._likelihood_kernels import Evidence
from slam.matching._proposal_kernels import Proposed
from slam.matching.proposal import beam_model, propose_poses, search_of
from slam.motion.odometry_model import checked_odometry, motion_prior
from slam.occupancy import OccupancyGrid
from slam.particles.ancestry import Ancestry
from slam.particles.particle_count import next_count
from slam.particles.resampling import SCHEMES
from slam.particles.weights import Weights, pose_covariance
from slam.scan import Scan
from slam.sensor.rays import Readings, rays_of, readings_of
from slam.step.loop_detector import Revisits


@dataclass(frozen=True, kw_only=True, eq=False)
class StepReport:
    """What one scan did to the filter."""

    updated: bool
    """Whether the filter took the scan in; below the update gates only the pose moves on by odometry."""
    pose: se2.Pose
    """Pose of the best particle at this scan in the map's frame, (3,)."""
    covariance: NDArray[np.float64]
    """Covariance of the pose over the particles in the map's frame, (3, 3)."""
    particles: int
    """Number of particles that took the scan in: before resampling, which may change it."""
    ess: float
    """Effective sample size before resampling."""
    readings: Readings
    """The scan's readings by kind."""
    resampled: bool = False
    """Whether particles were resampled after this scan."""
    matched_share: float = 0.0
    """Share of the hits within the outlier distance of a wall, weighted mean over the particles."""
    match_failures: int = 0
    """Particles whose scan matching failed."""
    log_evidence: float = 0.0
    """Log-likelihood of this scan given all earlier ones [nats]."""
    unique_ancestors: int = 0
    """Founders of which particles are alive; starts anew after all descended from a single one."""
    best: int = 0
    """Number of the particle of the largest weight."""
    map_bytes: int = 0
    """Memory of all maps [bytes]."""
    loop_closed: bool = False
    """Whether the best particle has just come back to a place that it left long ago."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Wall time of the stages: match (proposal), map, resample (with weights)."""
    proposed: Proposed | None = None
    """Samples, Gaussians and new poses of all particles before resampling; None for the first scan and for those
    that are not taken in."""


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
        """A filter without a map; `threads` defaults to the cores of this machine."""
        self.config = config or FilterConfig()
        n = self.config.first_particles
        self._rng = np.random.default_rng(seed)
        self._threads = Threads(threads)
        self.maps = ParticleMaps(n, self.config.map, self._threads)
        self.ancestry = Ancestry(n)
        self._weights = Weights.uniform(n)
        self._poses = np.zeros((n, 3))
        self._revisits = Revisits()
        self._odometry: se2.Pose | None = None  # at the last scan that was taken in
        self._stamp = 0.0
        self._scans = 0
        self._update_scans: list[int] = []
        self._spread = np.zeros((n, 3, 3))

    def process(
        self, odometry: ArrayLike, scan: Scan | Sequence[Scan], *, twist: ArrayLike | None = None
    ) -> StepReport:
        """Take in one scan, or the scans of several lidars at the same time.

        odometry: `T_odom_robot` (3,) at the first beam;  twist: velocity `(vx, vy, omega)` [m/s, m/s, rad/s] of the
        robot in its own frame while the scan was taken, to undo the motion where the beams' times are known

        Raises:
            ValueError: the odometry or the twist is not three finite numbers, or the map would grow beyond all
                bounds; poses, weights and maps are then as they were before.
        """
        now = checked_odometry(odometry, twist)
        scans = [scan] if isinstance(scan, Scan) else list(scan)
        readings = readings_of(scans)
        self._scans += 1
        first = self._odometry is None
        motion = np.zeros(3) if self._odometry is None else se2.between(self._odometry, now)
        if not first and not self.config.gate.opens(motion, scans[0].stamp - self._stamp):
            return self._report_between(motion, readings)
        rays = rays_of(
            scans,
            usable_range=self.config.map.usable_range,
            free_range=self.config.map.free_range,
            twist=twist if self.config.deskew else None,
        )
        if not first and not rays.hit.any():
            return self._report_between(motion, readings)  # a scan that saw nothing tells nothing
        report = self._begin(rays, readings) if first else self._update(motion, rays, readings)
        self._odometry, self._stamp = now, scans[0].stamp
        self._update_scans.append(self._scans - 1)
        return report

    def _report_between(self, motion: se2.Pose, readings: Readings) -> StepReport:
        """The state carried on by odometry, for a scan that is not taken in."""
        return StepReport(
            updated=False,
            pose=se2.compose(self._poses[self.best], motion),
            covariance=self.covariance,
            particles=len(self._poses),
            ess=self._weights.ess,
            unique_ancestors=self.ancestry.unique_ancestors,
            best=self.best,
            readings=readings,
            map_bytes=self.maps.bytes_in_use,
        )

    def _begin(self, rays: Rays, readings: Readings) -> StepReport:
        """The first scan: all particles start at the origin and draw it into their maps."""
        started = time.perf_counter()
        self.maps.register(self._poses, rays)
        self.ancestry.add(self._poses)
        return StepReport(
            updated=True,
            pose=self._poses[self.best].copy(),
            covariance=self.covariance,
            particles=len(self._poses),
            ess=self._weights.ess,
            unique_ancestors=self.ancestry.unique_ancestors,
            best=self.best,
            readings=readings,
            map_bytes=self.maps.bytes_in_use,
            seconds={"match": 0.0, "map": time.perf_counter() - started, "resample": 0.0},
        )

    def _update(self, motion: se2.Pose, rays: Rays, readings: Readings) -> StepReport:
        """One pass of Algorithm 1."""
        clock = [time.perf_counter()]
        proposed = self._propose(motion, rays)
        clock.append(time.perf_counter())

        self.maps.register(proposed.pose, rays)  # may refuse: before anything has changed
        clock.append(time.perf_counter())

        self._poses = proposed.pose.copy()
        self._weights, evidence = self._weights.times(self.config.match.weight_share * proposed.log_gain)
        self.ancestry.add(self._poses)
        self._spread = proposed.covariance

        ess, best, weights = self._weights.ess, self.best, self._weights.values
        pose, covariance = self._poses[best].copy(), self.covariance
        resampled = self._resample(ess, covariance)
        clock.append(time.perf_counter())

        return StepReport(
            updated=True,
            pose=pose,
            covariance=covariance,
            particles=len(weights),
            ess=ess,
            resampled=resampled,
            matched_share=min(float(weights @ proposed.matched), 1.0),  # the weights' sum may round above 1
            match_failures=int(proposed.failed.sum()),
            log_evidence=evidence,
            unique_ancestors=self.ancestry.unique_ancestors,
            best=best,
            readings=readings,
            map_bytes=self.maps.bytes_in_use,
            loop_closed=self._revisits.arrive(pose, float(np.hypot(motion[0], motion[1]))),
            seconds=dict(zip(("match", "map", "resample"), np.diff(clock).tolist(), strict=True)),
            proposed=proposed,
        )

    def _propose(self, motion: se2.Pose, rays: Rays) -> Proposed:
        """Lines 4 to 21 of Algorithm 1 for all particles: match, sample, fit, draw, weigh."""
        cfg = self.config
        hits = np.ascontiguousarray(rays.ends[rays.hit])
        evidence = Evidence(hits, beam_model(cfg.match, cfg.map), motion_prior(motion, cfg.motion))
        search = search_of(motion, hits, cfg)
        return propose_poses(
            self.maps, se2.compose(self._poses, motion), evidence, search, cfg.proposal.samples, self._rng
        )

    def _resample(self, ess: float, covariance: NDArray[np.float64]) -> bool:
        policy, n = self.config.resample, len(self._poses)
        count = next_count(n, covariance, self.config.adapt)
        due = policy.when == "always" or (policy.when == "ess" and ess < policy.threshold * n)
        if not due and count == n:
            return False
        ancestors = SCHEMES[policy.scheme](self._weights.values, self._rng, count)
        self._poses = self._poses[ancestors]
        self._spread = self._spread[ancestors]
        self.maps.descend(ancestors)
        self.ancestry.descend(ancestors)
        self._weights = Weights.uniform(count)
        return True

    @property
    def poses(self) -> se2.Pose:
        """Poses of the particles at the last scan that was taken in, (particles, 3)."""
        return self._poses.copy()

    @property
    def weights(self) -> NDArray[np.float64]:
        """Weights of the particles, (particles,); they sum to 1."""
        return self._weights.values

    @property
    def best(self) -> int:
        """Number of the particle of the largest weight."""
        return self._weights.best

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance (3, 3) of the pose in the map's frame: spread of the particles plus that of their proposals."""
        return pose_covariance(self._poses, self._weights.values, self._spread)

    @property
    def update_scans(self) -> NDArray[np.int64]:
        """Numbers of the scans that were taken in, (updates,); the rows of a path belong to them."""
        return np.array(self._update_scans, dtype=np.int64)

    def state(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Everything that the filter remembers: named arrays, and plain values fit for JSON."""
        arrays = {
            "poses": self._poses,
            "log_weights": self._weights.logs,
            "spread": self._spread,
            "odometry": np.empty(0) if self._odometry is None else self._odometry,
            "update_scans": self.update_scans,
            **self.maps.state(),
            **self.ancestry.state(),
        }
        values = {
            "rng": self._rng.bit_generator.state,
            "stamp": self._stamp,
            "scans": self._scans,
            "revisits": self._revisits.state(),
        }
        return arrays, values

    def restore(self, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> None:
        """Take over what `state` gave, from a filter of the same settings."""
        self._poses = arrays["poses"]
        self._weights = Weights(arrays["log_weights"])
        self._spread = arrays["spread"]
        self._odometry = arrays["odometry"] if arrays["odometry"].size else None
        self._update_scans = arrays["update_scans"].tolist()
        self.maps.restore(arrays)
        self.ancestry.restore(arrays)
        self._rng.bit_generator.state = values["rng"]
        self._stamp, self._scans = values["stamp"], values["scans"]
        self._revisits.restore(values["revisits"])

    def path(self, particle: int | None = None) -> se2.Pose:
        """Path of a particle (default: the best) through all updates, (updates, 3)."""
        return self.ancestry.path(self.best if particle is None else particle)

    def map(self, particle: int | None = None) -> OccupancyGrid:
        """Map of a particle (default: the best)."""
        return self.maps.occupancy(self.best if particle is None else particle)
