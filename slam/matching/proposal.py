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
from slam.matching._proposal_kernels import IMPROVED, MOTION, SCAN_MATCH, match_from, match_particles, propose
from slam.matching.likelihood import BeamModel
from slam.matching.wide_search import wide_starts
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
    mode: NDArray[np.float64]
    """Uniform variates in [0, 1) that choose among several optima, (particles,)."""


class Matches(NamedTuple):
    """Optimum of p(z | m, x) p(x | x', u) for each particle."""

    sample: NDArray[np.float64]
    """A sample of the motion model, (particles, 3)."""
    optimum: NDArray[np.float64]
    """Pose of the optimum, (particles, 3)."""
    factor: NDArray[np.float64]
    """Cholesky factor of the cost's Hessian there, (particles, 3, 3)."""
    cost: NDArray[np.float64]
    """Cost there [nats], (particles,)."""
    matched: NDArray[np.float64]
    """Share of the hits near a wall there, (particles,)."""
    share: NDArray[np.float64]
    """Probability with which this optimum was drawn from among several, (particles,)."""


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
    *,
    weights: NDArray[np.float64],
) -> ProposalResult:
    """Match, sample, fit, draw and weight: particle i starts from `guesses[i]` (particles, 3) and uses its own map.

    Fewer maps than particles must all be the same map; particle i then uses number i modulo their count.
    samples: poses drawn about each optimum (K);  weights (particles,)
    """
    n = len(guesses)
    draws = Draws(
        near=rng.standard_normal((samples, 3)),
        pose=rng.standard_normal((n, 3)),
        component=rng.uniform(size=n),
        mode=rng.uniform(size=n),
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
        drawn = Draws(draws.near, draws.pose[part], draws.component[part], draws.mode[part])
        rows = ProposalResult._make(array[part] for array in out)
        matches = _match(maps, guesses[part], scan_and_prior, search, drawn, weights[part])
        maps.threads.run(
            propose, len(rows.pose), maps.grids, guesses[part], scan_and_prior, search, drawn, matches, rows
        )
    return out


def _match(
    maps: ParticleMaps,
    guesses: se2.Pose,
    scan_and_prior: ScanAndPrior,
    search: MatchSettings,
    draws: Draws,
    weights: NDArray[np.float64],
) -> Matches:
    """Optima for all particles; the search is wide where a jump could explain the scan better."""
    n = len(guesses)
    matches = Matches(
        sample=np.empty((n, 3)),
        optimum=np.empty((n, 3)),
        factor=np.empty((n, 3, 3)),
        cost=np.full(n, np.inf),
        matched=np.zeros(n),
        share=np.empty(n),
    )
    maps.threads.run(match_particles, n, maps.grids, guesses, scan_and_prior, search, draws, matches)
    if search.kind != IMPROVED:
        return matches
    hits, beams, prior = scan_and_prior
    lowest = -float(prior.log_scale[2])
    wanted = _may_have_jumped(matches, scan_and_prior, guesses)
    STATS["n"] = STATS.get("n", 0) + 1
    if wanted.any():
        STATS["wide"] = STATS.get("wide", 0) + 1
        one = int(np.argmax(np.where(wanted, weights, -1.0)))
        bound = float(matches.cost[one]) - lowest
        starts = wide_starts(maps, one, guesses[one], hits, beams, prior, bound)
        if len(starts):
            STATS["starts"] = STATS.get("starts", 0) + 1
            maps.threads.run(
                match_from, n, maps.grids, guesses, scan_and_prior, search.iterations, starts, wanted, draws, matches
            )
    return matches


STATS: dict[str, int] = {}


def _may_have_jumped(matches: Matches, scan_and_prior: ScanAndPrior, guesses: se2.Pose) -> NDArray[np.bool_]:
    """Whether a pose far from the predicted one could have a lower cost, (particles,): a bound.

    At best all beams that match nothing would match there.
    """
    hits, beams, prior = scan_and_prior
    worst = 0.5 * beams.weight * beams.per_sigma2 * beams.far**2 / (1.0 + beams.far**2 * beams.per_outlier2)
    gain = worst * len(hits) * (1.0 - matches.matched)
    away = se2.between(guesses, matches.optimum)
    logs = prior.log_scale - 0.5 * np.sum(prior.precision * away[:, None, :] ** 2, axis=-1)
    charge = np.logaddexp.reduce(logs, axis=-1) - prior.log_scale[2]
    wanted: NDArray[np.bool_] = gain > charge
    return wanted


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
        sample_scale=SAMPLE_SCALE,
    )
