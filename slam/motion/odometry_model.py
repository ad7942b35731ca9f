# SPDX-License-Identifier: MIT
"""The motion model p(x | x', u) of an odometry that is right most of the time, and fails now and then."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam.config import MotionConfig


class MotionPrior(NamedTuple):
    """p(x | x', u) about the predicted pose: a mixture of three zero-mean Gaussians in the predicted robot's frame."""

    precision: NDArray[np.float64]
    """1 / variance along, across [1/m^2] and in heading [1/rad^2], (3, 3): odometry good, odometry failed,
    robot moved in a way of which the odometry says nothing."""
    log_scale: NDArray[np.float64]
    """Log of share times the Gaussian's normalisation, (3,)."""
    share: NDArray[np.float64]
    """Share of each component, (3,)."""


def motion_prior(motion: ArrayLike, config: MotionConfig) -> MotionPrior:
    """Density of the true pose about the one that the odometry predicts, for displacements (..., 3).

    First component: deviations that grow with the distance driven and the angle turned (the terms of Thrun, Burgard,
    Fox 2005, section 5.4, as standard deviations per unit of motion). Second component, of share
    `config.failure_share`: the odometry has failed, as when a wheel slips or driving backwards is counted as
    forwards; then the error along the heading may be as large as the distance itself, up to a limit. Third
    component, of share `config.jump_share`: the odometry says nothing of the step, as when wheels spin on the spot or
    the robot is pushed; its deviations do not depend on the displacement.
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
    sigma = np.empty((*distance.shape, 3, 3))
    sigma[..., 0, 0] = sigma[..., 0, 1] = position
    sigma[..., 0, 2] = heading
    sigma[..., 1, 0] = position + np.minimum(config.failure_along * distance, config.failure_limit)
    sigma[..., 1, 1] = 2.0 * position
    sigma[..., 1, 2] = heading + config.failure_rotation * angle
    sigma[..., 2, :] = config.jump_along, config.jump_across, config.jump_rotation
    share = np.array([1.0 - config.failure_share - config.jump_share, config.failure_share, config.jump_share])
    with np.errstate(divide="ignore"):  # a share of 0 never counts: its logarithm is -inf
        log_scale = np.log(share) - np.log(sigma).sum(axis=-1) - 1.5 * np.log(2.0 * np.pi)
    return MotionPrior(precision=sigma**-2.0, log_scale=log_scale, share=share)


def sample_motion(poses: se2.Pose, motion: ArrayLike, config: MotionConfig, rng: np.random.Generator) -> se2.Pose:
    """Poses (n, 3) after a displacement (3,), each with an error drawn from the motion model."""
    n, prior = len(poses), motion_prior(motion, config)
    component = rng.choice(3, size=n, p=prior.share)
    error = rng.standard_normal((n, 3)) * prior.precision[component] ** -0.5
    return se2.compose(se2.compose(poses, motion), error)
