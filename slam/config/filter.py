# SPDX-License-Identifier: MIT
"""Settings of the filter: frozen dataclasses that check themselves; classic GMapping names in brackets."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from slam.config._checks import LARGEST, require_at_least, require_at_most, require_one_of, require_positive
from slam.config.motion import MotionConfig
from slam.config.refinement import RefineConfig

MAX_PARTICLES = 1_000_000
"""Largest number of particles."""
MAX_SAMPLES = 100_000
"""Largest number of poses drawn or compared for one particle, of beams, and of rounds."""


@dataclass(frozen=True, kw_only=True)
class MapConfig:
    """The grid map of each particle."""

    cell: float = 0.05
    """Side of a cell [m] (delta)."""
    occupied_share: float = 0.25
    """A cell is drawn as occupied when at least this share of the beams that reached it ended in it (occ_thresh)."""
    wall_share: float = 0.15
    """The matcher takes a cell for a wall when at least this share did, and no cell beside it holds more end points."""
    usable_range: float = 80.0
    """Readings beyond this range are treated as no return [m] (maxUrange)."""
    free_range: float = 0.0
    """Beams without a return clear the map up to this distance [m]; 0 = they are not used."""
    field_radius: float = 0.4
    """The matcher takes walls up to this distance from an end point into account [m]."""

    def __post_init__(self) -> None:
        require_positive(self, "cell", "occupied_share", "wall_share", "field_radius")
        require_at_least(self, 0.0, "free_range")
        if not self.occupied_share < 1.0:
            raise ValueError(f"MapConfig.occupied_share must be below 1, got {self.occupied_share:g}")
        if not self.usable_range > 0.0:  # may be infinite
            raise ValueError(f"MapConfig.usable_range must be positive, got {self.usable_range:g}")


@dataclass(frozen=True, kw_only=True)
class MatchConfig:
    """Scan matching and the beam end point model (T-RO 2007, section IV-B)."""

    hit_sigma: float = 0.03
    """Standard deviation of beam end points from a wall [m] (sigma)."""
    beam_weight: float = 0.07
    """Share of each beam's log-likelihood that counts in matching and in the proposal: neighbouring beams are not
    independent, and the errors of neighbouring scans are alike (`slam.matching.proposal.next_errors`)."""
    outlier_distance: float = 0.3
    """End points farther from a wall than this count as outliers [m]."""
    min_matched_share: float = 0.1
    """Matching fails if a smaller share of the hits lies within the outlier distance (minimumScore)."""
    search_reach: float = 0.8
    """Search range along the heading [m]. Used: twice the distance driven, clipped to 0.5 to 1 times this value."""
    search_step: float = 0.1
    """Distance between the starting poses of that search [m]."""
    coarse_share: float = 0.3
    """Share of the beam weight with which starting poses are compared to the odometry."""
    coarse_beams: int = 60
    """Starting poses are compared by every k-th hit, but by at least this many hits if the scan has them."""
    weight_share: float = 0.012
    """Share of log eta that goes into the particles' weights (1 / ogain). Two maps of one room differ by their noise
    far more than eta accounts for; with full weight the particles that can close the next loop would die out."""
    iterations: int = 20
    """Largest number of Gauss-Newton steps in one match (iterations)."""

    def __post_init__(self) -> None:
        require_positive(self, "hit_sigma", "beam_weight", "outlier_distance", "search_step")
        require_at_least(self, 0.0, "search_reach", "coarse_share", "weight_share", "min_matched_share")
        require_at_least(self, 1, "iterations", "coarse_beams")
        require_at_most(self, MAX_SAMPLES, "iterations", "coarse_beams")
        require_at_most(self, LARGEST, "weight_share")
        if not self.search_reach / self.search_step <= MAX_SAMPLES:
            raise ValueError(
                f"MatchConfig.search_reach {self.search_reach:g} m holds more than {MAX_SAMPLES:,} steps of "
                f"search_step {self.search_step:g} m"
            )


@dataclass(frozen=True, kw_only=True)
class ProposalConfig:
    """How a new pose is drawn for each particle."""

    kind: Literal["improved", "scan-match", "motion"] = "improved"
    """improved: Gaussian fitted to samples around the optimum; scan-match: the optimum itself, searched from a sample
    of the motion model as in the C++ GMapping; motion: that sample itself (FastSLAM 1). The C++ maximises the scan's
    score alone; here the motion model, centred at the sample, stays in the product, so that a pose leaves its sample
    only where the scan says so."""
    samples: int = 20
    """Number of poses sampled around the optimum (K)."""
    sampling: Literal["gaussian", "even"] = "gaussian"
    """gaussian: the K poses are drawn from the Laplace approximation at the optimum, which leaves most of them a weight
    that counts; even: evenly from an interval around it, as the paper says."""
    sample_range: float = 0.01
    """For `even`: half the width of the interval in x and y [m] (llsamplerange)."""
    sample_range_heading: float = 0.005
    """For `even`: half the width of the interval of the heading [rad] (lasamplerange)."""

    def __post_init__(self) -> None:
        require_one_of(self, "kind")
        require_one_of(self, "sampling")
        require_at_least(self, 1, "samples")
        require_at_most(self, MAX_SAMPLES, "samples")
        require_positive(self, "sample_range", "sample_range_heading")


@dataclass(frozen=True, kw_only=True)
class ResampleConfig:
    """When and how particles are resampled."""

    when: Literal["ess", "always", "never"] = "ess"
    """ess: when the effective sample size is below the threshold; always: at each update; never: not at all."""
    threshold: float = 0.5
    """Share of the particle count below which the effective sample size triggers resampling (resampleThreshold)."""
    scheme: Literal["systematic", "stratified", "residual", "multinomial"] = "systematic"
    """Scheme by which offspring are drawn."""

    def __post_init__(self) -> None:
        require_one_of(self, "when")
        require_one_of(self, "scheme")
        require_at_least(self, 0.0, "threshold")


@dataclass(frozen=True, kw_only=True)
class AdaptConfig:
    """Number of particles from scan to scan (`slam.particles.particle_count`); localisation has a rule of its own."""

    count: Literal["fixed", "kld"] = "fixed"
    """fixed: the number never changes; kld: KLD-sampling decides from the belief of the pose (Fox 2003)."""
    min_particles: int = 10
    """Smallest number of particles: n samples give the deviation to 1 / sqrt(2 (n - 1)), 24 % for 10."""
    max_particles: int = 60
    """Largest number of particles."""
    position: float = 0.3
    """Side of the bins [m]: the matcher's outlier distance, up to which poses are attracted by the same walls."""
    heading: float = 0.1
    """Height of the bins [rad]: the angle by which a wall 3 m away moves by one side of a bin."""
    error: float = 0.25
    """Bound on the divergence between belief and particles [nats] (epsilon). The default gives at least three particles
    for each bin, so that the bin with the truth is empty in at most 5 % of the cases."""
    quantile: float = 2.33
    """Quantile of the normal distribution at the probability with which the bound holds (z at 1 - delta)."""
    resize_factor: float = 1.5
    """The number changes only if the wanted and the present number differ by at least this factor."""

    def __post_init__(self) -> None:
        require_one_of(self, "count")
        require_positive(self, "position", "heading", "error", "quantile")
        require_at_least(self, 1, "min_particles", "resize_factor")
        require_at_least(self, self.min_particles, "max_particles")
        require_at_most(self, MAX_PARTICLES, "max_particles")


@dataclass(frozen=True, kw_only=True)
class GateConfig:
    """Update gates: the filter uses the first scan, and each after enough motion or time since the last used one."""

    distance: float = 0.15
    """The filter uses a scan after this distance driven since the last used one [m] (linearUpdate)."""
    angle: float = 0.1
    """The filter also uses a scan after this angle turned [rad] (angularUpdate)."""
    seconds: float = 0.0
    """The filter also uses a scan after this time [s] (temporalUpdate); 0 = time alone never triggers an update."""

    def __post_init__(self) -> None:
        require_at_least(self, 0.0, "distance", "angle", "seconds")


@dataclass(frozen=True, kw_only=True)
class FilterConfig:
    """All settings of the particle filter."""

    particles: int = 30
    """Number of particles, if it is fixed (filter.adapt.count)."""
    motion: MotionConfig = field(default_factory=MotionConfig)
    """Motion model."""
    map: MapConfig = field(default_factory=MapConfig)
    """Grid maps."""
    match: MatchConfig = field(default_factory=MatchConfig)
    """Scan matching and likelihood."""
    proposal: ProposalConfig = field(default_factory=ProposalConfig)
    """Proposal distribution."""
    resample: ResampleConfig = field(default_factory=ResampleConfig)
    """Resampling."""
    adapt: AdaptConfig = field(default_factory=AdaptConfig)
    """Number of particles from scan to scan."""
    gate: GateConfig = field(default_factory=GateConfig)
    """Update gates."""
    refine: RefineConfig = field(default_factory=RefineConfig)
    """Final pass."""
    deskew: bool = True
    """Undo the robot's motion during a scan, if the times of the beams and the twist are known."""

    def __post_init__(self) -> None:
        require_at_least(self, 1, "particles")
        require_at_most(self, MAX_PARTICLES, "particles")
        if self.adapt.count != "fixed" and self.resample.when == "never":
            raise ValueError("FilterConfig: the particle count can only adapt where particles are resampled")

    @property
    def first_particles(self) -> int:
        """Number of particles at the first scan: where it adapts as few as there may be, since the pose is known."""
        return self.particles if self.adapt.count == "fixed" else self.adapt.min_particles

    @property
    def max_particles(self) -> int:
        """Number of particles that there can be at most."""
        return self.particles if self.adapt.count == "fixed" else self.adapt.max_particles
