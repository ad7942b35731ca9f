# SPDX-License-Identifier: MIT
"""Scan matching: step I of the improved proposal, the optimum of p(z | m, x) p(x | x', u) (T-RO 2007, section III-B).

The search starts at the predicted pose and along its heading. Where a jump of the robot, of which the odometry says
nothing, could explain the scan better, the search covers everything that the motion model allows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config import FilterConfig
from slam.grid.particle_maps import ParticleMaps
from slam.matching._likelihood_kernels import wall_distances
from slam.matching._scan_matching_kernels import gain_of_jump, likely_starts, match_from, match_particles
from slam.matching.likelihood import BeamModel, ScanAndPrior
from slam.matching.wide_search import wide_starts

MIN_MODE_SHARE = 0.01
"""An optimum found by the wide search counts where its mode has this share of the mass in the map of the heaviest
particle: a filter of some dozen particles places none in a rarer one."""


class MatchSettings(NamedTuple):
    """How the optimum of p(z | m, x) p(x | x', u) is searched, the same for all particles."""

    iterations: int
    """Largest number of Gauss-Newton steps."""
    starts: NDArray[np.float64]
    """Further starting points seen from the predicted pose, (n, 3)."""
    coarse: BeamModel
    """Beam model with a wide basin, by which starting points are compared."""
    coarse_hits: NDArray[np.float64]
    """Every k-th hit, for that comparison, (n, 2)."""


class Matches(NamedTuple):
    """Optimum of p(z | m, x) p(x | x', u) for each particle."""

    optimum: NDArray[np.float64]
    """Pose of the optimum, (particles, 3)."""
    factor: NDArray[np.float64]
    """Cholesky factor of the cost's Hessian there, (particles, 3, 3)."""
    cost: NDArray[np.float64]
    """Cost there [nats], (particles,)."""
    matched: NDArray[np.float64]
    """Share of the hits near a wall there, (particles,)."""
    probability: NDArray[np.float64]
    """Probability with which this optimum was drawn from among several, (particles,)."""
    jump_gain: NDArray[np.float64]
    """What a jump could gain at most over the optimum near the predicted pose [nats], (particles,)."""


def empty_matches(count: int) -> Matches:
    """Room for the matches of so many particles."""
    cost, matched, jump_gain = np.empty((3, count))
    return Matches(np.empty((count, 3)), np.empty((count, 3, 3)), cost, matched, np.ones(count), jump_gain)


def match_scan(
    maps: ParticleMaps,
    predicted: se2.Pose,
    scan_and_prior: ScanAndPrior,
    search: MatchSettings,
    *,
    weights: NDArray[np.float64],
    u: NDArray[np.float64],
    out: Matches,
) -> None:
    """Match a scan in the map of each particle; predicted (particles, 3): the poses about which the prior lies.

    weights (particles,): the wide search uses the map of the heaviest particle that asks for it, seen from whose pose
    the others' maps look alike; each then matches from the same starting points in its own map
    u (particles,): uniform variates in [0, 1), which choose among several optima
    """
    n, iterations = len(predicted), search.iterations
    maps.threads.run(match_particles, n, maps.grids, predicted, scan_and_prior, search, out)
    wanted = out.jump_gain > 0.0
    if not wanted.any():
        return
    one = int(np.argmax(np.where(wanted, weights, -1.0)))
    starts = wide_starts(maps, one, predicted[one], scan_and_prior, max_cost=out.cost[one])
    likely = np.empty_like(starts)
    count = likely_starts(
        maps.grids, one, predicted[one], scan_and_prior, iterations, starts, out, MIN_MODE_SHARE, likely
    )
    if count > 0:
        arguments = (maps.grids, predicted, scan_and_prior, iterations, likely[:count], wanted, u, out)
        maps.threads.run(match_from, n, *arguments)


def shows_a_jump(
    maps: ParticleMaps, particle: int, predicted: se2.Pose, scan_and_prior: ScanAndPrior, matched_before: float
) -> bool:
    """Whether a jump could explain a scan better than the predicted pose (3,) does, by the map of one particle.

    The bound of the wide search, at the predicted pose itself. At the last update a share `matched_before` of the hits
    met a wall; as many as met none then do not count.
    """
    hits, beams, _ = scan_and_prior
    distances = np.empty((4, len(hits)))
    wall_distances(maps.grids, particle, *predicted, hits, beams.far, distances)
    matched = float(np.mean((distances[0] ** 2 + distances[1] ** 2) * beams.per_outlier2 <= 1.0))
    return bool(gain_of_jump(scan_and_prior, predicted, predicted, 1.0 - max(matched_before - matched, 0.0)) > 0.0)


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
        iterations=match.iterations,
        starts=starts,
        coarse=BeamModel(
            per_sigma2=match.hit_sigma**-2.0,
            per_outlier2=config.map.field_radius**-2.0,
            weight=match.beam_weight * match.coarse_share * len(hits) / max(len(every_kth), 1),
            far=config.map.field_radius,
        ),
        coarse_hits=every_kth,
    )
