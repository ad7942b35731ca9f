# SPDX-License-Identifier: MIT
"""How far the odometry errs, estimated from the data: factors on the variances of its motion model.

One step of expectation maximisation in each round of the adjustment (Dempster, Laird, Rubin 1977): the expected squared
errors of the steps, given the scans, over those that the motion model expects. Steps in which the odometry failed
belong to other components of the model and do not count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.motion.odometry_model import MotionPrior
from slam.refinement._chain_kernels import expected_step_errors

MIN_FACTOR = 1e-3
"""Smallest factor of one round: steps without any error (a robot at rest) must not make the odometry certain."""


def variance_factors(
    prior: MotionPrior,
    poses: se2.Pose,
    motions: se2.Pose,
    factors: NDArray[np.float64],
    eliminated: NDArray[np.float64],
) -> tuple[float, float]:
    """Factors by which the variances of position and of heading should change.

    prior: of all steps, arrays (frames - 1, ...);  poses (frames, 3);  motions (frames - 1, 3)
    factors and eliminated: of the equations with the walls held (`factor_chain`)
    """
    sums = np.empty(4)
    expected_step_errors(prior, poses, motions, factors, eliminated, sums)
    along, across, heading, steps = sums.tolist()
    if not steps > 0.0:
        return 1.0, 1.0
    return max((along + across) / (2.0 * steps), MIN_FACTOR), max(heading / steps, MIN_FACTOR)


def with_variances(prior: MotionPrior, position: float, heading: float) -> MotionPrior:
    """The prior with the variances of its first component multiplied by a factor for position and one for heading."""
    precision, log_scale = prior.precision.copy(), prior.log_scale.copy()
    precision[..., 0, :2] /= position
    precision[..., 0, 2] /= heading
    log_scale[..., 0] -= np.log(position) + 0.5 * np.log(heading)
    return prior._replace(precision=precision, log_scale=log_scale)
