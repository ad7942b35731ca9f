# SPDX-License-Identifier: MIT
"""Settings of localisation in a finished map."""

from __future__ import annotations

from dataclasses import dataclass

from slam.config._checks import require_at_least, require_at_most, require_positive

MAX_SEARCH_POSES = 10_000_000
"""Largest number of poses that a search may compare."""


@dataclass(frozen=True, kw_only=True)
class LocalizationConfig:
    """Settings of localisation in a finished map, in addition to those of the filter; never used while mapping."""

    start_position: float = 0.3
    """Standard deviation of a given start in x and in y [m]."""
    start_heading: float = 0.15
    """Standard deviation of a given start's heading [rad]."""
    weight_share: float = 0.2
    """Share of log eta that goes into the weights, instead of `MatchConfig.weight_share`: all particles share one map,
    so only the errors that the map and later scans have in common are a reason against the full weight."""
    explained_distance: float = 0.15
    """The map explains a hit that is at most this far from a wall [m]."""
    min_explained_share: float = 0.7
    """The robot is lost if the map explains a smaller share of the hits, averaged over the last updates."""
    explained_memory: float = 10.0
    """Memory of that average [updates]."""
    found_weight: float = 0.99
    """The robot counts as found when one cluster of particles holds at least this weight."""
    cluster_position: float = 0.5
    """Poses this close together belong to one cluster [m]; also the side of the bins of KLD-sampling."""
    cluster_heading: float = 0.26
    """Poses whose headings differ by less may belong to one cluster [rad]; also the height of these bins."""
    search_spacing: float = 0.3
    """Unknown start: distance between the first poses [m]."""
    search_spacing_heading: float = 0.15
    """Unknown start: angle between the first headings [rad]."""
    search_sigma: float = 0.25
    """Standard deviation of end points from a wall during the search, whose poses are coarse [m]."""
    search_radius: float = 1.0
    """Distance from a wall up to which the search takes it into account [m]."""
    search_beams: int = 60
    """The search uses every k-th hit, but at least this many hits if the scan has them."""
    independent_beams: float = 8.0
    """One scan counts as this many independent beams in the search."""
    max_search_poses: int = 50_000
    """Largest number of particles in the search."""
    max_candidates: int = 1000
    """Matching the particles one by one begins when at most this many are left."""
    kld_error: float = 0.05
    """Bound on the divergence between belief and particles [nats] (Fox 2003: epsilon)."""
    kld_quantile: float = 2.33
    """Quantile of the normal distribution at the probability with which the bound holds (Fox 2003: z at 1 - delta)."""

    def __post_init__(self) -> None:
        require_positive(
            self,
            "start_position",
            "start_heading",
            "weight_share",
            "explained_distance",
            "cluster_position",
            "cluster_heading",
        )
        require_positive(
            self, "search_spacing", "search_spacing_heading", "search_sigma", "search_radius", "independent_beams"
        )
        require_positive(self, "kld_error", "kld_quantile")
        require_at_least(self, 1, "explained_memory", "search_beams", "max_search_poses", "max_candidates")
        require_at_most(self, MAX_SEARCH_POSES, "search_beams", "max_search_poses", "max_candidates")
        for name in ("min_explained_share", "found_weight"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise ValueError(f"LocalizationConfig.{name} must be in (0, 1), got {getattr(self, name)}")
