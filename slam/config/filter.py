# SPDX-License-Identifier: MIT
"""Settings of the filter: one frozen dataclass a part, checked on creation; classic GMapping names in brackets."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray


def _positive(owner: object, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        if not value > 0:
            raise ValueError(f"{type(owner).__name__}.{name} must be positive, got {value}")


def _at_least(owner: object, least: float, *names: str) -> None:
    for name in names:
        value = getattr(owner, name)
        if not value >= least:
            raise ValueError(f"{type(owner).__name__}.{name} must be at least {least:g}, got {value}")


def _one_of(owner: object, name: str) -> None:
    known, value = get_args(get_type_hints(type(owner))[name]), getattr(owner, name)
    if value not in known:
        raise ValueError(f"{type(owner).__name__}.{name} must be one of {', '.join(known)}, got {value!r}")


@dataclass(frozen=True, kw_only=True)
class MotionConfig:
    """Standard deviations of the odometry's error per unit of motion (the filter's belief, not the robot's truth)."""

    translation_from_translation: float = 0.1
    """Error along the path per metre driven [m/m] (srr)."""
    translation_from_rotation: float = 0.05
    """Error of position per radian turned [m/rad] (srt)."""
    rotation_from_translation: float = 0.1
    """Error of heading per metre driven [rad/m] (str)."""
    rotation_from_rotation: float = 0.1
    """Error of heading per radian turned [rad/rad] (stt)."""
    floor_translation: float = 0.005
    """Error that is there even at rest [m]."""
    floor_rotation: float = 0.003
    """Error of heading that is there even at rest [rad]."""
    failure_share: float = 0.05
    """Share of the steps in which the odometry fails (slip, wrong sign): the tail of the motion model."""
    failure_along: float = 1.0
    """Error along the heading per metre driven in such a step [m/m]."""
    failure_limit: float = 0.4
    """The largest standard deviation of that error: wheels slip and directions change on short stretches [m]."""
    failure_rotation: float = 0.3
    """Further error of heading per radian turned in such a step [rad/rad]."""

    def __post_init__(self) -> None:
        _positive(self, "floor_translation", "floor_rotation")
        _at_least(self, 0.0, "translation_from_translation", "translation_from_rotation")
        _at_least(self, 0.0, "rotation_from_translation", "rotation_from_rotation")
        _at_least(self, 0.0, "failure_along", "failure_limit", "failure_rotation")
        if not 0.0 <= self.failure_share < 1.0:
            raise ValueError(f"MotionConfig.failure_share must be in [0, 1), got {self.failure_share}")


@dataclass(frozen=True, kw_only=True)
class MapConfig:
    """The grid map of each particle."""

    cell: float = 0.05
    """Side of a cell [m] (delta)."""
    occupied_share: float = 0.25
    """A cell is a wall when at least this share of the beams that reached it ended in it (occ_thresh)."""
    usable_range: float = 80.0
    """Readings beyond are treated as no return [m] (maxUrange)."""
    free_range: float = 0.0
    """Beams without a return clear the map up to this distance [m]; 0 = they are left out."""
    field_radius: float = 0.4
    """How far from a wall the matcher still feels it [m]."""

    def __post_init__(self) -> None:
        _positive(self, "cell", "occupied_share", "usable_range", "field_radius")
        _at_least(self, 0.0, "free_range")


@dataclass(frozen=True, kw_only=True)
class MatchConfig:
    """Scan matching and the beam end point model (T-RO 2007, section IV-B)."""

    hit_sigma: float = 0.03
    """Spread of beam end points about a wall [m] (sigma)."""
    beam_weight: float = 0.07
    """Share of each beam's log-likelihood that counts in the match and in the proposal: neighbouring beams are not
    independent."""
    outlier_distance: float = 0.3
    """End points farther from a wall than this are explained by something else [m]."""
    min_matched_share: float = 0.1
    """Matching fails where fewer of the hits lie within the outlier distance (minimumScore)."""
    search_reach: float = 0.8
    """The search also starts from poses shifted along the heading by up to twice the distance driven, at least by half
    of this and at most by this much [m]."""
    search_step: float = 0.1
    """Distance of these starting poses [m]."""
    coarse_share: float = 0.3
    """Share of the beam weight with which starting poses are compared to the odometry."""
    coarse_beams: int = 60
    """Hits by which they are compared at least, where the scan has that many: every k-th one."""
    weight_share: float = 0.012
    """Share of log eta that goes into the particles' weights (1 / ogain): two maps of one place differ by their own
    noise far more than eta knows, and at full weight the particles that could close the next loop die of it."""
    iterations: int = 20
    """Most Gauss-Newton steps in one match (iterations)."""

    def __post_init__(self) -> None:
        _positive(self, "hit_sigma", "beam_weight", "outlier_distance", "search_step")
        _at_least(self, 0.0, "search_reach", "coarse_share", "weight_share", "min_matched_share")
        _at_least(self, 1, "iterations", "coarse_beams")


@dataclass(frozen=True, kw_only=True)
class ProposalConfig:
    """How a new pose is drawn for each particle."""

    kind: Literal["improved", "scan-match", "motion"] = "improved"
    """improved: Gaussian fitted to samples about the optimum; scan-match: the optimum itself, searched from a sample
    of the motion model as in the C++ GMapping; motion: that sample itself (FastSLAM 1). The C++ maximises the scan's
    score alone; here the motion model, centred at the sample, stays in the product, so that a pose leaves its sample
    only where the scan says so."""
    samples: int = 20
    """Poses drawn about the optimum (K)."""

    def __post_init__(self) -> None:
        _one_of(self, "kind")
        _at_least(self, 1, "samples")


@dataclass(frozen=True, kw_only=True)
class ResampleConfig:
    """When and how particles are resampled."""

    when: Literal["ess", "always", "never"] = "ess"
    """ess: when the effective sample size falls below the threshold."""
    threshold: float = 0.5
    """Share of the particle count below which the effective sample size triggers resampling (resampleThreshold)."""
    scheme: Literal["systematic", "stratified", "residual", "multinomial"] = "systematic"
    """How offspring are drawn."""

    def __post_init__(self) -> None:
        _one_of(self, "when")
        _one_of(self, "scheme")
        _at_least(self, 0.0, "threshold")


@dataclass(frozen=True, kw_only=True)
class AdaptConfig:
    """How many particles there are, from scan to scan (`slam.particles.particle_count`); localisation has a rule of its own."""

    count: Literal["fixed", "kld"] = "fixed"
    """fixed: always as many; kld: as many as KLD-sampling asks for the belief of the pose (Fox 2003)."""
    least: int = 10
    """Fewest particles: the deviation of n samples is known to 1 / sqrt(2 (n - 1)), 24 % for 10."""
    most: int = 60
    """Most particles."""
    position: float = 0.3
    """Side of the bins [m]; the matcher's outlier distance: poses this far apart are drawn to the same walls."""
    heading: float = 0.1
    """Height of the bins [rad]; the angle at which a wall 3 m away moves by one side."""
    error: float = 0.25
    """Bound on the divergence between belief and particles [nats] (epsilon): three particles a bin or more, so that the
    one with the truth in it is empty in 5 % of the cases at most."""
    quantile: float = 2.33
    """Quantile of the normal distribution at the probability with which the bound holds (z at 1 - delta)."""
    change: float = 1.5
    """Particles are resampled to the count that is asked for where it differs from theirs by this factor or more."""

    def __post_init__(self) -> None:
        _one_of(self, "count")
        _positive(self, "position", "heading", "error", "quantile")
        _at_least(self, 1, "least", "change")
        _at_least(self, self.least, "most")


@dataclass(frozen=True, kw_only=True)
class GateConfig:
    """Which scans the filter takes in: the first, and each after enough motion or time since the last one taken."""

    distance: float = 0.15
    """Distance driven [m] (linearUpdate)."""
    angle: float = 0.1
    """Angle turned [rad] (angularUpdate)."""
    seconds: float = 0.0
    """Time passed [s] (temporalUpdate); 0 = time alone never triggers an update."""

    def __post_init__(self) -> None:
        _at_least(self, 0.0, "distance", "angle", "seconds")

    def opens(self, motion: NDArray[np.float64], seconds: float) -> bool:
        """Whether a scan is taken in after a displacement `motion` (3,) [m, m, rad] and a time since the last one."""
        return bool(
            np.hypot(motion[0], motion[1]) >= self.distance
            or abs(motion[2]) >= self.angle
            or (self.seconds > 0.0 and seconds >= self.seconds)
        )


@dataclass(frozen=True, kw_only=True)
class RefineConfig:
    """The final pass over a recording; never used inside the filter."""

    rounds: int = 6
    """How often the walls are found anew."""
    hit_sigma: float = 0.02
    """Spread of end points about a wall near by [m]; less than in the filter, whose map still grows."""
    range_share: float = 0.01
    """Spread that comes on top of it along the beam, as a share of the range."""
    first_gate: float = 0.2
    """In the first round end points up to this far from a wall, plus three standard deviations, belong to it [m]."""
    gate_decay: float = 0.6
    """The gate narrows by this factor from round to round ..."""
    last_gate: float = 0.03
    """... down to this: things that stand before a wall must not pull [m]."""
    cell: float = 0.05
    """Side of the cells into which end points are sorted [m]."""
    window: float = 0.15
    """Radius of the windows in which lines are fitted [m], rounded to cells."""
    flatness: float = 0.15
    """End points form a line where their variance across it is at most this share of that along it."""
    spacing: float = 0.25
    """Distance of the surfels along a wall, at least [m]."""
    most_points: int = 3_000_000
    """Of recordings with more hits each k-th one is used for the poses; the map takes all."""
    motion: MotionConfig = field(
        default_factory=lambda: MotionConfig(
            floor_translation=0.001,
            floor_rotation=0.002,
            rotation_from_translation=0.2,
            rotation_from_rotation=0.2,
        )
    )
    """Motion model between neighbouring frames, which lie closer together than the updates of the filter: less error
    at rest, more per metre and radian, since errors of many short steps partly cancel."""

    def __post_init__(self) -> None:
        _at_least(self, 1, "rounds", "most_points")
        _at_least(self, 0.0, "range_share", "first_gate", "last_gate")
        _positive(self, "hit_sigma", "gate_decay", "cell", "window", "flatness", "spacing")
        if not self.gate_decay <= 1.0:
            raise ValueError(f"RefineConfig.gate_decay must be at most 1, got {self.gate_decay}")
        if not self.window >= self.cell:
            raise ValueError(f"RefineConfig.window must be at least one cell of {self.cell} m, got {self.window} m")


@dataclass(frozen=True, kw_only=True)
class FilterConfig:
    """All settings of the particle filter."""

    particles: int = 30
    """Number of particles, where it is fixed."""
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
    """Undo the robot's motion during a scan where the times of the beams and the twist are known."""

    def __post_init__(self) -> None:
        _at_least(self, 1, "particles")
        if self.adapt.count != "fixed" and self.resample.when == "never":
            raise ValueError("FilterConfig: the particle count can only adapt where particles are resampled")

    @property
    def first_particles(self) -> int:
        """Number of particles at the first scan: where it adapts as few as there may be, since the pose is known."""
        return self.particles if self.adapt.count == "fixed" else self.adapt.least

    @property
    def most_particles(self) -> int:
        """Number of particles that there can be at most."""
        return self.particles if self.adapt.count == "fixed" else self.adapt.most


@dataclass(frozen=True, kw_only=True)
class LocalizationConfig:
    """Localisation in a finished map, beside the settings of the filter; never used while mapping."""

    start_position: float = 0.3
    """Standard deviation of a given start in x and in y [m]."""
    start_heading: float = 0.15
    """Standard deviation of a given start's heading [rad]."""
    weight_share: float = 0.2
    """Share of log eta that goes into the weights, in the place of `MatchConfig.weight_share`: all particles see one
    map, so only the errors that the map and the next scans have in common speak against full weight."""
    near: float = 0.15
    """A hit this close to a wall is explained by the map [m]."""
    least_fit: float = 0.7
    """The robot is lost where a smaller share of the hits is explained, mean over the last updates."""
    fit_memory: float = 10.0
    """Updates over which that mean forgets."""
    sure: float = 0.99
    """Weight that must lie in one place before the robot counts as found."""
    place_position: float = 0.5
    """Poses this close together are one place [m]; also the side of the bins of KLD-sampling."""
    place_heading: float = 0.26
    """Poses whose headings differ by less may be one place [rad]; also the height of these bins."""
    spread_position: float = 0.3
    """Unknown start: distance of the first poses [m]."""
    spread_heading: float = 0.15
    """Unknown start: angle between the first headings [rad]."""
    search_sigma: float = 0.25
    """Spread of end points about a wall while poses are this coarse [m]."""
    search_radius: float = 1.0
    """How far from a wall the search feels it [m]."""
    search_beams: int = 60
    """Hits that the search looks at, at least, where the scan has that many."""
    independent_beams: float = 8.0
    """Independent beams that one scan counts as in the search."""
    most_poses: int = 50_000
    """Most particles of the search."""
    most_candidates: int = 1000
    """Particles from which on they are matched one by one."""
    kld_error: float = 0.05
    """Bound on the divergence between belief and particles [nats] (Fox 2003: epsilon)."""
    kld_quantile: float = 2.33
    """Quantile of the normal distribution at the probability with which the bound holds (Fox 2003: z at 1 - delta)."""

    def __post_init__(self) -> None:
        _positive(self, "start_position", "start_heading", "weight_share", "near", "place_position", "place_heading")
        _positive(self, "spread_position", "spread_heading", "search_sigma", "search_radius", "independent_beams")
        _positive(self, "kld_error", "kld_quantile")
        _at_least(self, 1, "fit_memory", "search_beams", "most_poses", "most_candidates")
        for name in ("least_fit", "sure"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise ValueError(f"LocalizationConfig.{name} must be in (0, 1), got {getattr(self, name)}")
