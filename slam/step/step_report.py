# SPDX-License-Identifier: MIT
"""What one scan did to a filter: the report of a step, and the clock of its stages."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.diagnosis.beam_check import BeamEvidence
from slam.diagnosis.contradiction import SelfCheck
from slam.matching.proposal import ProposalResult
from slam.particles.particle_set import ParticleSet
from slam.sensor.rays import BeamCounts


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StepReport:
    """What one scan did to the filter."""

    updated: bool
    """Whether the filter used the scan; below the update gates only the pose moves on by odometry."""
    pose: se2.Pose
    """Pose of the best particle at this scan in the map's frame, (3,)."""
    covariance: NDArray[np.float64]
    """Covariance of the pose over the particles in the map's frame, (3, 3)."""
    particles: int
    """Number of particles that used the scan: before resampling, which may change it."""
    ess: float
    """Effective sample size before resampling."""
    readings: BeamCounts
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
    """Number of ancestors from which the particles descend; counting starts anew once there is a single one."""
    best: int = 0
    """Number of the most likely particle: that of the largest weight over its whole history."""
    map_bytes: int = 0
    """Memory of all maps [bytes]."""
    loop_length: float = 0.0
    """Length of the loop that this scan closes: path of the estimate since the walls that it sees were last seen, or
    since the robot was last where it is [m]; 0 = none."""
    loop_at_place: bool = False
    """Whether the robot is back at a place where it was; else the loop is that of the walls."""
    loop_updates: int = 0
    """How many updates ago it was there, or saw these walls."""
    odometry_jumped: bool = False
    """Whether the odometry has jumped since the scan before; it is then joined (`slam.motion.continuous_odometry`)."""
    beams: BeamEvidence | None = None
    """What the map of the best particle says of the scan's beams; None where the filter did not compare them."""
    self_check: SelfCheck | None = None
    """What the filter's own evidence says of the estimate at this scan; None from localisation, which has a status."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Wall time of the stages: match (proposal), map, resample (with weights)."""
    proposed: ProposalResult | None = None
    """Samples, Gaussians and new poses of all particles before resampling; None for the first scan and for those
    that the filter does not use."""

    @property
    def loop_closed(self) -> bool:
        """Whether the robot sees an area again that it left long ago."""
        return self.loop_length > 0.0

    def __repr__(self) -> str:
        """One line, for notebooks."""
        x, y, theta = self.pose
        nothing = self.matched_share == 0.0 and self.match_failures == 0  # as of the first scan: there was no map
        matched = "nothing to match with yet" if nothing else f"matched {self.matched_share:.0%}"
        used = f"updated, {matched}" if self.updated else "not updated"
        return f"<StepReport: ({x:.3f}, {y:.3f}, {theta:.3f}), ess {self.ess:.1f} of {self.particles}, {used}>"


def report_state(particles: ParticleSet, readings: BeamCounts, *, pose: se2.Pose, map_bytes: int) -> StepReport:
    """Report of a scan that the filter does not match: the state as it is, at a pose (3,) in the map's frame."""
    return StepReport(
        updated=False,
        pose=pose,
        covariance=particles.covariance,
        particles=len(particles),
        ess=particles.weights.ess,
        readings=readings,
        unique_ancestors=particles.ancestry.unique_ancestors,
        best=particles.best,
        map_bytes=map_bytes,
    )


def report_update(
    particles: ParticleSet, result: ProposalResult, readings: BeamCounts, *, pose: se2.Pose, evidence: float
) -> StepReport:
    """Report of a matched scan before resampling, at a pose (3,) in the map's frame."""
    weights = particles.weights
    return StepReport(
        updated=True,
        pose=pose,
        covariance=particles.covariance,
        particles=len(particles),
        ess=weights.ess,
        readings=readings,
        matched_share=min(float(weights.values @ result.matched), 1.0),  # the weights' sum may round above 1
        match_failures=int(result.failed.sum()),
        log_evidence=evidence,
        best=particles.best,
        proposed=result,
    )


class StageClock:
    """Wall time of the stages of a step, one after the other."""

    def __init__(self) -> None:
        """Start the first stage."""
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def end_stage(self, name: str) -> None:
        """End the stage that has this name; the next one begins."""
        now = time.perf_counter()
        self.seconds[name] = now - self._last
        self._last = now
