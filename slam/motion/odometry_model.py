# SPDX-License-Identifier: MIT
"""The motion model p(x | x', u) of an odometry that is good most of the time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from slam.config.filter import MotionConfig
from slam.matching._likelihood_kernels import MotionPrior
from slam.se2 import Pose


def checked_odometry(odometry: ArrayLike, twist: ArrayLike | None) -> Pose:
    """The odometry (3,) as an array; ValueError where it or the twist (3,) is not three finite numbers."""
    now = np.asarray(odometry, dtype=np.float64)
    if twist is not None and not np.all(np.isfinite(twist)):
        raise ValueError(f"twist must be three finite numbers (vx, vy, omega), got {twist}")
    if now.shape != (3,) or not np.all(np.isfinite(now)):
        raise ValueError(f"odometry must be three finite numbers (x, y, theta), got {now.tolist()}")
    return now


def motion_prior(motion: ArrayLike, config: MotionConfig) -> MotionPrior:
    """Density of the true pose about the one that the odometry predicts, for displacements (..., 3).

    First component: deviations that grow with the distance driven and the angle turned (the terms of Thrun, Burgard,
    Fox 2005, section 5.4, as standard deviations per unit of motion). Second component, of share
    `config.failure_share`: the odometry has failed, as when a wheel slips or driving backwards is counted as
    forwards; then the error along the heading may be as large as the distance itself, up to a limit.
    """
    moved = np.asarray(motion, dtype=np.float64)
    distance, angle = np.hypot(moved[..., 0], moved[..., 1]), np.abs(moved[..., 2])
    position = (
        config.floor_translation
        + config.translation_from_translation * distance
        + config.translation_from_rotation * angle
    )
    heading = (
        config.floor_rotation + config.rotation_from_translation * distance + config.rotation_from_rotation * angle
    )
    sigma = np.empty((*distance.shape, 2, 3))
    sigma[..., 0, 0] = sigma[..., 0, 1] = position
    sigma[..., 0, 2] = heading
    sigma[..., 1, 0] = position + np.minimum(config.failure_along * distance, config.failure_limit)
    sigma[..., 1, 1] = 2.0 * position
    sigma[..., 1, 2] = heading + config.failure_rotation * angle
    with np.errstate(divide="ignore"):  # a share of 0 never counts: its logarithm is -inf
        log_share = np.log([1.0 - config.failure_share, config.failure_share])
    log_scale = log_share - np.log(sigma).sum(axis=-1) - 1.5 * np.log(2.0 * np.pi)
    return MotionPrior(precision=sigma**-2.0, log_scale=log_scale)
