# SPDX-License-Identifier: MIT
"""The motion model p(x | x', u) of an odometry that is good most of the time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slam._match_kernels import MotionPrior
from slam.config import MotionConfig


def motion_prior(motion: ArrayLike, config: MotionConfig) -> MotionPrior:
    """Density of the true pose about the one that the odometry predicts, for one displacement (3,).

    First component: deviations that grow with the distance driven and the angle turned (the terms of Thrun, Burgard,
    Fox 2005, section 5.4, as standard deviations per unit of motion). Second component, of share
    `config.failure_share`: the odometry has failed, as when a wheel slips or driving backwards is counted as
    forwards; then the error along the heading may be as large as the distance itself.
    """
    x, y, turn = np.asarray(motion, dtype=np.float64)
    distance, angle = np.hypot(x, y), abs(turn)
    position = (
        config.floor_translation
        + config.translation_from_translation * distance
        + config.translation_from_rotation * angle
    )
    heading = (
        config.floor_rotation + config.rotation_from_translation * distance + config.rotation_from_rotation * angle
    )
    failed_along = position + config.failure_along * distance
    failed_heading = heading + config.failure_rotation * angle
    sigma = np.array([[position, position, heading], [failed_along, 2.0 * position, failed_heading]])
    share = np.array([1.0 - config.failure_share, config.failure_share])
    log_scale = np.log(np.maximum(share, 1e-300)) - np.log(sigma).sum(axis=1) - 1.5 * np.log(2.0 * np.pi)
    return MotionPrior(precision=sigma**-2.0, log_scale=log_scale)
