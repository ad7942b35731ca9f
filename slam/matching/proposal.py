# SPDX-License-Identifier: MIT
"""The improved proposal: new poses of all particles from one scan, lines 4 to 21 of Algorithm 1 (T-RO 2007)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config import FilterConfig
from slam.grid.particle_maps import ParticleMaps
from slam.matching._proposal_kernels import IMPROVED, MOTION, SCAN_MATCH, propose
from slam.matching.likelihood import BeamModel
from slam.motion.odometry_model import MotionPrior

KINDS = {"improved": IMPROVED, "scan-match": SCAN_MATCH, "motion": MOTION}
"""Numbers of the kinds of proposal in the kernels."""
SAMPLE_SCALE = 1.2
"""Standard deviation of the K poses in units of the Laplace approximation's at the optimum. Importance weights stay
bounded only where the sampling density is at least as wide as the product (Owen 2013, chapter 9), and the bounded
loss makes the product wider than its curvature at the optimum says."""


class ScanAndPrior(NamedTuple):
    """The scan and the motion prior, by which a new pose is judged: the same for all particles."""

    hits: NDArray[np.float64]
    """End points of the scan in the robot's frame [m], (K, 2)."""
    beams: BeamModel
    """Likelihood of the scan."""
    prior: MotionPrior
    """Density of the pose about the one that the odometry predicts."""


class MatchSettings(NamedTuple):
    """How the optimum of p(z | m, x) p(x | x', u) is searched, the same for all particles."""

    kind: int
    """One of `KINDS`."""
    iterations: int
    """Largest number of Gauss-Newton steps."""
    starts: NDArray[np.float64]
    """Further starting points seen from the predicted pose, (n, 3)."""
    coarse: BeamModel
    """Beam model with a wide basin, by which starting points are compared."""
    coarse_hits: NDArray[np.float64]
    """Every k-th hit, for that comparison, (n, 2)."""
    fail_share: float
    """Share of the hits near a wall below which matching has failed."""
    failure_share: float
    """Share of the steps in which the odometry has failed: the second component of the motion prior."""
    sample_scale: float
    """Standard deviation of the K poses in units of the Laplace approximation's."""


class Draws(NamedTuple):
    """All random numbers of one step; the same number is drawn whichever of them are used."""

    near: NDArray[np.float64]
    """Standard normal variates for the poses about the optimum, (K, 3); common to all particles, which makes their
    weights comparable at small K."""
    pose: NDArray[np.float64]
    """Standard normal variates for the new pose, (particles, 3)."""
    component: NDArray[np.float64]
    """Uniform variates in [0, 1) that choose the component of the motion model, (particles,)."""


class ProposalResult(NamedTuple):
    """What the proposals made of the particles."""

    pose: NDArray[np.float64]
    """New poses, (particles, 3)."""
    log_gain: NDArray[np.float64]
    """What is added to each log-weight: log eta, or the log-likelihood where the motion model was sampled."""
    mean: NDArray[np.float64]
    """Mean of the fitted Gaussian, (particles, 3)."""
    covariance: NDArray[np.float64]
    """Covariance of the fitted Gaussian in the map's frame, (particles, 3, 3)."""
    matched: NDArray[np.float64]
    """Share of the hits near a wall, (particles,)."""
    failed: NDArray[np.bool_]
    """Whether matching failed, (particles,)."""
    samples: NDArray[np.float64]
    """The K poses drawn about the optimum, (particles, K, 3); NaN where none were drawn."""


def propose_poses(
    maps: ParticleMaps,
    guesses: se2.Pose,
    scan_and_prior: ScanAndPrior,
    search: MatchSettings,
    samples: int,
    rng: np.random.Generator,
) -> ProposalResult:
    """Match, sample, fit, draw and weight: particle i starts from `guesses[i]` (particles, 3) and uses its own map.

    Fewer maps than particles must all be the same map; particle i then uses number i modulo their count.
    samples: poses drawn about each optimum (K)
    """
    n = len(guesses)
    draws = Draws(
        near=rng.standard_normal((samples, 3)),
        pose=rng.standard_normal((n, 3)),
        component=rng.uniform(size=n),
    )
    out = ProposalResult(
        pose=np.empty((n, 3)),
        log_gain=np.empty(n),
        mean=np.empty((n, 3)),
        covariance=np.zeros((n, 3, 3)),
        matched=np.empty(n),
        failed=np.empty(n, np.bool_),
        samples=np.empty((n, samples, 3)),
    )
    count = len(maps.grids.table)
    for first in range(0, n, count):
        part = slice(first, first + count)
        drawn = Draws(draws.near, draws.pose[part], draws.component[part])
        rows = ProposalResult._make(array[part] for array in out)
        maps.threads.run(propose, len(rows.pose), maps.grids, guesses[part], scan_and_prior, search, drawn, rows)
    return out


def make_match_settings(motion: se2.Pose, hits: NDArray[np.float64], config: FilterConfig) -> MatchSettings:
    """Settings of the search for one displacement (3,) [m, m, rad] and the hits (K, 2) [m] of a scan.

    The starting points lie along the heading: there odometry fails when wheels slip or a change of direction goes
    unnoticed.
    """
    match = config.match
    reach = min(max(0.5 * match.search_reach, 2.0 * float(np.hypot(motion[0], motion[1]))), match.search_reach)
    steps = math.ceil(reach / match.search_step)
    shifts = np.arange(-steps, steps + 1) * match.search_step
    every_kth = np.ascontiguousarray(hits[:: max(1, len(hits) // match.coarse_beams)])
    starts = np.zeros((2 * steps, 3))
    starts[:, 0] = shifts[shifts != 0.0]
    return MatchSettings(
        kind=KINDS[config.proposal.kind],
        iterations=match.iterations,
        starts=starts,
        coarse=BeamModel(
            per_sigma2=match.hit_sigma**-2.0,
            per_outlier2=config.map.field_radius**-2.0,
            weight=match.beam_weight * match.coarse_share * len(hits) / max(len(every_kth), 1),
            far=config.map.field_radius,
        ),
        coarse_hits=every_kth,
        fail_share=match.min_matched_share,
        failure_share=config.motion.failure_share,
        sample_scale=SAMPLE_SCALE,
    )
