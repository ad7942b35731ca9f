# SPDX-License-Identifier: MIT
"""Resampling schemes (Douc, Cappe, Moulines 2005): from weights to the ancestor of each of N offspring.

Each takes weights (particles,), non-negative, a generator and the number N of offspring (default: as many as there
are particles), and returns N ancestors in ascending order. The expected number of offspring of particle i is N w_i in
all of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam.config import ResampleConfig

BELOW_ONE = np.nextafter(1.0, 0.0)


def _inverse_cdf(weights: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Particles at `points` in [0, 1) of the cumulated weights."""
    cumulative = np.cumsum(weights)
    cumulative /= cumulative[-1]
    # (u + N - 1) / N rounds to 1 for u just below 1, which would be one past the last particle
    return np.searchsorted(cumulative, np.minimum(points, BELOW_ONE), side="right")


def systematic(weights: NDArray[np.float64], rng: np.random.Generator, count: int | None = None) -> NDArray[np.int64]:
    """One random number, N evenly spaced points: each particle gets floor or ceil of its share."""
    n = len(weights) if count is None else count
    return _inverse_cdf(weights, (rng.uniform() + np.arange(n)) / n)


def stratified(weights: NDArray[np.float64], rng: np.random.Generator, count: int | None = None) -> NDArray[np.int64]:
    """One random point in each of N equal strata."""
    n = len(weights) if count is None else count
    return _inverse_cdf(weights, (rng.uniform(size=n) + np.arange(n)) / n)


def multinomial(weights: NDArray[np.float64], rng: np.random.Generator, count: int | None = None) -> NDArray[np.int64]:
    """N independent draws."""
    n = len(weights) if count is None else count
    return _inverse_cdf(weights, np.sort(rng.uniform(size=n)))


def residual(weights: NDArray[np.float64], rng: np.random.Generator, count: int | None = None) -> NDArray[np.int64]:
    """floor(N w) copies of each particle, the remaining ones drawn from the fractional parts."""
    n = len(weights) if count is None else count
    shares = n * weights / weights.sum()
    copies = np.floor(shares).astype(np.int64)
    missing = n - int(copies.sum())
    if missing > 0:
        drawn = _inverse_cdf(shares - copies, np.sort(rng.uniform(size=missing)))
        copies += np.bincount(drawn, minlength=len(weights))
    return np.repeat(np.arange(len(weights)), copies)


SCHEMES = {"systematic": systematic, "stratified": stratified, "multinomial": multinomial, "residual": residual}


def resampling_is_due(policy: ResampleConfig, ess: float, particles: int) -> bool:
    """Whether that many particles of this effective sample size are to be resampled (T-RO 2007, section III-B)."""
    return policy.when == "always" or (policy.when == "ess" and ess < policy.threshold * particles)
