# SPDX-License-Identifier: MIT
"""From settings and one scan to new poses of all particles: lines 4 to 21 of Algorithm 1 (T-RO 2007)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config.filter import FilterConfig, MapConfig, MatchConfig
from slam.grid.particle_maps import ParticleMaps
from slam.matching._likelihood_kernels import BeamModel, Evidence
from slam.matching._proposal_kernels import IMPROVED, MOTION, SCAN_MATCH, Draws, Proposed, Search, propose

KINDS = {"improved": IMPROVED, "scan-match": SCAN_MATCH, "motion": MOTION}


def propose_poses(
    maps: ParticleMaps,
    guesses: se2.Pose,
    evidence: Evidence,
    search: Search,
    samples: int,
    rng: np.random.Generator,
) -> Proposed:
    """Match, sample, fit, draw, weigh: particle i starts from `guesses[i]` (particles, 3) and looks at its own map.

    Where there are fewer maps than particles they must all be alike; particle i then looks at number i modulo their
    count.  samples: poses drawn about each optimum (K)
    """
    n = len(guesses)
    draws = Draws(
        near=rng.standard_normal((samples, 3)),
        pose=rng.standard_normal((n, 3)),
        component=rng.uniform(size=n),
    )
    out = Proposed(
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
        rows = Proposed._make(array[part] for array in out)
        maps.threads.run(propose, len(rows.pose), maps.grids, guesses[part], evidence, search, drawn, rows)
    return out


def beam_model(match: MatchConfig, grid: MapConfig) -> BeamModel:
    """Numbers of the beam end point model from the settings."""
    return BeamModel(
        per_sigma2=match.hit_sigma**-2.0,
        per_outlier2=match.outlier_distance**-2.0,
        weight=match.beam_weight,
        far=grid.field_radius,
    )


def search_of(motion: se2.Pose, hits: NDArray[np.float64], config: FilterConfig) -> Search:
    """Settings of the search for one displacement (3,) and the hits (K, 2) of a scan: the starting points lie along
    the heading, where odometry fails when wheels slip or a change of direction goes unnoticed."""
    match = config.match
    reach = min(max(0.5 * match.search_reach, 2.0 * float(np.hypot(motion[0], motion[1]))), match.search_reach)
    steps = math.ceil(reach / match.search_step)
    shifts = np.arange(-steps, steps + 1) * match.search_step
    few = np.ascontiguousarray(hits[:: max(1, len(hits) // match.coarse_beams)])
    starts = np.zeros((2 * steps, 3))
    starts[:, 0] = shifts[shifts != 0.0]
    return Search(
        kind=KINDS[config.proposal.kind],
        iterations=match.iterations,
        starts=starts,
        coarse=BeamModel(
            per_sigma2=match.hit_sigma**-2.0,
            per_outlier2=config.map.field_radius**-2.0,
            weight=match.beam_weight * match.coarse_share * len(hits) / max(len(few), 1),
            far=config.map.field_radius,
        ),
        coarse_hits=few,
        fail_share=match.min_matched_share,
        second_share=config.motion.failure_share,
        spread=1.2,
    )
