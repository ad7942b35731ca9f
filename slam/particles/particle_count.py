# SPDX-License-Identifier: MIT
"""How many particles the filter continues with: a rule on the belief of the pose, separate from resampling itself."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.config import AdaptConfig
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
    """Number of particles to continue with; `present` unless the wanted number differs by `AdaptConfig.resize_factor`.

    covariance (3, 3) of the pose in the map's frame
    """
    if config.count == "fixed":
        return present
    bins = bins_covered(covariance, config.position, config.heading)
    needed = math.ceil(particles_needed(bins, error=config.error, quantile=config.quantile))
    wanted = min(max(needed, config.min_particles), config.max_particles)
    return present if max(wanted, present) < config.resize_factor * min(wanted, present) else wanted
