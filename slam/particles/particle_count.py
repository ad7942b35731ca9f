# SPDX-License-Identifier: MIT
"""How many particles the filter goes on with: a rule on the belief of the pose, apart from the resampling itself."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.config.filter import AdaptConfig
from slam.particles.kld import particles_needed


def bins_covered(covariance: NDArray[np.float64], position: float, heading: float) -> float:
    """Bins of `position` [m] by `position` by `heading` [rad] that a Gaussian over poses covers, 1 or more.

    covariance (3, 3). Two standard deviations to both sides along each principal axis, in units of the bins; an axis
    that is shorter than a bin counts as one. Unlike the bins that the particles lie in, this neither depends on how
    the map is turned nor ends at the number of particles.
    """
    scale = np.array([position, position, heading])
    variances = np.linalg.eigvalsh(covariance / np.outer(scale, scale))
    return float(np.prod(np.maximum(4.0 * np.sqrt(np.maximum(variances, 0.0)), 1.0)))


def next_count(present: int, covariance: NDArray[np.float64], config: AdaptConfig) -> int:
    """Number of particles to go on with, from `present` ones and the covariance (3, 3) of the pose in the map's frame;
    `present` itself unless another number is wanted by the factor `AdaptConfig.change`."""
    if config.count == "fixed":
        return present
    bins = bins_covered(covariance, config.position, config.heading)
    needed = math.ceil(particles_needed(bins, error=config.error, quantile=config.quantile))
    wanted = min(max(needed, config.least), config.most)
    return present if max(wanted, present) < config.change * min(wanted, present) else wanted
