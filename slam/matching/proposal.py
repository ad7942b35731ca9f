# SPDX-License-Identifier: MIT
"""The improved proposal: new poses of all particles from one scan, lines 4 to 21 of Algorithm 1 (T-RO 2007)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config import FilterConfig, ProposalConfig
from slam.grid.particle_maps import ParticleMaps
from slam.matching._proposal_kernels import IMPROVED, MOTION, SCAN_MATCH, propose, sample_motions
from slam.matching.likelihood import ScanAndPrior
from slam.matching.scan_matching import MatchSettings, empty_matches, match_scan

KINDS = {"improved": IMPROVED, "scan-match": SCAN_MATCH, "motion": MOTION}
"""Numbers of the kinds of proposal in the kernels."""
SAMPLE_SCALE = 1.2
"""Standard deviation of the K poses in units of the Laplace approximation's at the optimum. Importance weights stay
bounded only where the sampling density is at least as wide as the product (Owen 2013, chapter 9), and the bounded
loss makes the product wider than its curvature at the optimum says."""


class ProposalSettings(NamedTuple):
    """How a new pose is drawn, the same for all particles."""

    kind: int
    """One of `KINDS`."""
    fail_share: float
    """Share of the hits near a wall below which matching has failed."""
    sample_scale: float
    """Standard deviation of the K poses in units of the Laplace approximation's."""
    half_width: NDArray[np.float64]
    """Half the width of the interval from which the K poses are drawn evenly [m, m, rad], (3,); 0 = not evenly."""


class Draws(NamedTuple):
    """All random numbers of one step; the same number is drawn whichever of them are used."""

    near: NDArray[np.float64]
    """Standard normal variates for the poses about the optimum, (K, 3), or uniform ones in (-1, 1) where they are drawn
    evenly; common to all particles, which makes their weights comparable at small K."""
    motion: NDArray[np.float64]
    """Standard normal variates for a pose from the motion model, (particles, 3)."""
    error: NDArray[np.float64]
    """Deviation of the new pose from the mean of its Gaussian, in standard deviations along the axes of its Cholesky
    factor, (particles, 3)."""
    component: NDArray[np.float64]
    """Uniform variates in [0, 1) that choose the component of the motion model, (particles,)."""
    mode: NDArray[np.float64]
    """Uniform variates in [0, 1) that choose among several optima, (particles,)."""


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
    error: NDArray[np.float64]
    """By how much the new pose was drawn off that mean: `Draws.error`, (particles, 3)."""
    matched: NDArray[np.float64]
    """Share of the hits near a wall, (particles,)."""
    failed: NDArray[np.bool_]
    """Whether matching failed, (particles,)."""
    samples: NDArray[np.float64]
    """The K poses drawn about the optimum, (particles, K, 3); NaN where none were drawn."""
    sample_weights: NDArray[np.float64]
    """Their weights, of sum 1, (particles, K); NaN where none were drawn."""


def propose_poses(
    maps: ParticleMaps,
    guesses: se2.Pose,
    scan_and_prior: ScanAndPrior,
    search: MatchSettings,
    config: FilterConfig,
    rng: np.random.Generator,
    *,
    weights: NDArray[np.float64],
    errors: NDArray[np.float64] | None = None,
) -> ProposalResult:
    """Match, sample, fit, draw and weight: particle i starts from `guesses[i]` (particles, 3) and uses its own map.

    Fewer maps than particles must all be the same map; particle i then uses number i modulo their count.
    weights (particles,) before this scan;  errors (particles, 3) with which the last poses were drawn (see
    `next_errors`); None where the map is no work of the particles, whose poses are then drawn independently
    """
    n, samples, count = len(guesses), config.proposal.samples, len(maps.grids.table)
    near = rng.standard_normal((samples, 3))
    if config.proposal.sampling == "even":
        near = _uniform(near)
    normal, component, mode = rng.standard_normal((n, 3)), rng.uniform(size=n), rng.uniform(size=n)
    error = normal if errors is None else next_errors(errors, normal, config.match.beam_weight)
    out = ProposalResult(
        pose=np.empty((n, 3)),
        log_gain=np.empty(n),
        mean=np.empty((n, 3)),
        covariance=np.zeros((n, 3, 3)),
        error=error,
        matched=np.empty(n),
        failed=np.empty(n, np.bool_),
        samples=np.empty((n, samples, 3)),
        sample_weights=np.empty((n, samples)),
    )
    for first in range(0, n, count):
        part = slice(first, first + count)
        draws = Draws(near, normal[part], error[part], component[part], mode[part])
        rows = ProposalResult._make(array[part] for array in out)
        _propose_with_own_map(maps, guesses[part], scan_and_prior, search, config, draws, weights[part], rows)
    return out


def first_errors(count: int, beam_weight: float, generator: np.random.BitGenerator) -> NDArray[np.float64]:
    """Errors (count, 3) to begin the autoregression of `next_errors` with, of its variance: from zero on it would take
    many updates to reach that, in which the particles would be too sure.

    generator: its state is the seed, and stays as it is
    """
    rng = np.random.default_rng(generator.state["state"]["state"])
    return math.sqrt(min(beam_weight, 1.0)) * rng.standard_normal((count, 3))


def next_errors(errors: NDArray[np.float64], normal: NDArray[np.float64], beam_weight: float) -> NDArray[np.float64]:
    """Errors (particles, 3) of the next poses, in standard deviations, from those of the last ones.

    A particle's map errs with its poses, and the scans of neighbouring updates see the same pieces of wall: what they
    err by is alike, not independent. `beam_weight` w makes up for that where errors add up, over many updates. If each
    pose had an independent error of the variance 1 that follows from w, neighbouring poses, which the scans determine
    to millimetres, would differ by centimetres, and walls would be drawn that thick. Therefore the errors are an
    autoregression of first order (Box and Jenkins 1970) of variance w, which is that of beams that count in full, and
    with the correlation (1 - w) / (1 + w), with which the sum over many updates has the same variance as with
    independent errors of variance 1.

    normal (particles, 3): standard normal variates
    """
    w = min(beam_weight, 1.0)
    correlation = (1.0 - w) / (1.0 + w)
    return correlation * errors + math.sqrt(w * (1.0 - correlation**2)) * normal


def _uniform(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Uniform variates in (-1, 1) from as many standard normal ones, so that all settings draw the same numbers."""
    return np.array([math.erf(z / math.sqrt(2.0)) for z in normal.ravel()]).reshape(normal.shape)


def _half_width(config: ProposalConfig) -> NDArray[np.float64]:
    """Half the width of the interval of the K poses [m, m, rad], (3,); 0 if they are not drawn evenly."""
    if config.sampling != "even":
        return np.zeros(3)
    return np.array([config.sample_range, config.sample_range, config.sample_range_heading])


def _propose_with_own_map(
    maps: ParticleMaps,
    guesses: se2.Pose,
    scan_and_prior: ScanAndPrior,
    search: MatchSettings,
    config: FilterConfig,
    draws: Draws,
    weights: NDArray[np.float64],
    out: ProposalResult,
) -> None:
    """The same for at most as many particles as there are maps; out: their rows of the result."""
    n, kind = len(guesses), KINDS[config.proposal.kind]
    settings = ProposalSettings(kind, config.match.min_matched_share, SAMPLE_SCALE, _half_width(config.proposal))
    sampled, matches = np.empty((n, 3)), empty_matches(n)
    sample_motions(0, n, guesses, scan_and_prior.prior, draws, sampled)
    if kind != MOTION:
        predicted = sampled if kind == SCAN_MATCH else guesses
        match_scan(maps, predicted, scan_and_prior, search, weights=weights, u=draws.mode, out=matches)
    arguments = (maps.grids, guesses, scan_and_prior, settings, sampled, matches, draws, out)
    maps.threads.run(propose, n, *arguments)
