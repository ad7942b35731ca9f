# SPDX-License-Identifier: MIT
"""How many particles a belief needs: KLD-sampling (Fox, "Adapting the Sample Size in Particle Filters Through
KLD-Sampling", IJRR 22(12), 2003)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.se2 import Pose


def particles_needed(bins: ArrayLike, *, error: float, quantile: float) -> NDArray[np.float64]:
    """Samples after which the histogram of a distribution over `bins` bins (any shape) is known well enough.

    With the probability of which `quantile` is the upper standard normal quantile, the Kullback-Leibler divergence
    between the samples' histogram and the true one is then below `error` [nats]. Equation 7, by the approximation of
    Wilson and Hilferty; 1 for a single bin.
    """
    free = np.maximum(np.asarray(bins, dtype=np.float64) - 1.0, 0.0)
    a = 2.0 / (9.0 * np.maximum(free, 1.0))
    needed = free / (2.0 * error) * (1.0 - a + np.sqrt(a) * quantile) ** 3
    return np.where(free > 0.0, needed, 1.0)


def bins_of(poses: Pose, position: float, heading: float) -> NDArray[np.int64]:
    """Number of the bin of each pose (n, 3), (n,): cubes of `position` [m] by `position` by about `heading` [rad]."""
    turns = max(1, round(2.0 * np.pi / heading))
    columns = np.floor(poses[:, 0] / position).astype(np.int64)
    rows = np.floor(poses[:, 1] / position).astype(np.int64)
    sectors = np.floor(poses[:, 2] / (2.0 * np.pi) * turns).astype(np.int64) % turns
    columns -= columns.min(initial=0)
    rows -= rows.min(initial=0)
    bins: NDArray[np.int64] = (rows * (columns.max(initial=0) + 1) + columns) * turns + sectors
    return bins


def count_by_kld(
    bins: NDArray[np.int64],
    weights: NDArray[np.float64],
    rng: np.random.Generator,
    *,
    error: float,
    quantile: float,
    least: int,
    most: int,
) -> int:
    """Number of particles to draw from a weighted set: draws go on until there are as many as `particles_needed` asks
    for the bins that they have met (Fox 2003, table 2), but at least `least` and at most `most`.

    bins (particles,) as of `bins_of`;  weights (particles,): their sum is 1
    """
    drawn = bins[rng.choice(len(bins), size=most, p=weights)]
    new = np.zeros(most, dtype=bool)
    new[np.unique(drawn, return_index=True)[1]] = True
    enough = np.arange(1, most + 1) >= particles_needed(np.cumsum(new), error=error, quantile=quantile)
    enough[: least - 1] = False  # the very first draw would do for the one bin it is in
    return int(np.argmax(enough)) + 1 if enough.any() else most
