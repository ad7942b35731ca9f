# SPDX-License-Identifier: MIT
"""The odometry's noise from the data: the expected errors of its steps, and factors that are known are found again."""

import numpy as np
import pytest

from slam import se2
from slam.config import MotionConfig
from slam.motion.odometry_model import motion_prior
from slam.refinement._chain_kernels import add_odometry_steps, expected_step_errors, factor_chain, solve_chain
from slam.refinement.odometry_noise import variance_factors, with_variances

SURE = MotionConfig(failure_share=0.0, jump_share=0.0)
"""A motion model of one Gaussian."""


def drive(steps, rng, sigma):
    """Odometry's steps (steps, 3) and true poses: each step errs by sigma times what the motion model expects."""
    motions = np.tile([0.05, 0.0, 0.02], (steps, 1)) + rng.normal(scale=0.01, size=(steps, 3))
    spread = motion_prior(motions, SURE).precision[:, 0] ** -0.5
    errors = rng.normal(size=(steps, 3)) * spread * sigma
    poses = [np.zeros(3)]
    for motion, error in zip(motions, errors, strict=True):
        poses.append(se2.compose(se2.compose(poses[-1], motion), error))
    return motions, np.array(poses)


def equations(prior, poses, motions, precision):
    """The chain's equations with each pose measured with `precision` [1/m^2, 1/rad^2], and their factors."""
    n = len(poses)
    diagonal, coupling, gradient = np.tile(np.diag(precision), (n, 1, 1)), np.zeros((n - 1, 3, 3)), np.zeros((n, 3))
    add_odometry_steps(prior, poses, motions, diagonal, coupling, gradient)
    factors, eliminated = np.empty((n, 3, 3)), np.empty((n - 1, 3, 3))
    assert factor_chain(diagonal, coupling, factors, eliminated)
    return diagonal, coupling, gradient, factors, eliminated


def test_expected_errors_use_the_inverse_of_the_whole_chain():
    rng = np.random.default_rng(1)
    motions, poses = drive(12, rng, 1.0)
    prior, n = motion_prior(motions, SURE), len(poses)
    diagonal, coupling, _, factors, eliminated = equations(prior, poses, motions, [400.0, 300.0, 900.0])
    dense = np.zeros((3 * n, 3 * n))
    for i in range(n):
        dense[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = diagonal[i]
        if i + 1 < n:
            dense[3 * i : 3 * i + 3, 3 * i + 3 : 3 * i + 6] = coupling[i]
            dense[3 * i + 3 : 3 * i + 6, 3 * i : 3 * i + 3] = coupling[i].T
    covariance = np.linalg.inv(dense)

    def error(t, x):
        moved = poses[t : t + 2] + x.reshape(2, 3)
        return -se2.between(moved[1], se2.compose(moved[0], motions[t]))

    expected = np.zeros(3)
    for t in range(n - 1):
        step = 1e-6 * np.eye(6)
        jacobian = np.stack([(error(t, d) - error(t, -d)) / 2e-6 for d in step], axis=1)
        block = covariance[3 * t : 3 * t + 6, 3 * t : 3 * t + 6]
        squared = error(t, np.zeros(6)) ** 2 + np.diag(jacobian @ block @ jacobian.T)
        expected += squared * prior.precision[t, 0]
    sums = np.empty(4)
    expected_step_errors(prior, poses, motions, factors, eliminated, sums)
    np.testing.assert_allclose(sums, [*expected, n - 1], rtol=0.02)  # deviations are taken in the predicted frame


@pytest.mark.parametrize("sigma", [0.3, 1.0, 2.0])
def test_the_factors_settle_at_the_true_noise(sigma):
    """Expectation maximisation over poses that are measured as well as the odometry's steps err."""
    rng = np.random.default_rng(3)
    motions, true = drive(3000, rng, sigma)
    prior, poses = motion_prior(motions, SURE), true.copy()
    measured = true + rng.normal(size=true.shape) * [0.003, 0.003, 0.003]
    precision = np.full(3, 0.003**-2)
    total = np.ones(2)
    for _ in range(60):
        _, coupling, gradient, factors, eliminated = equations(prior, poses, motions, precision)
        gradient += (poses - measured) * precision
        n = len(poses)
        x = np.empty((n, 3))
        solve_chain(factors, eliminated, coupling, gradient, x)
        poses = poses - x
        factor = variance_factors(prior, poses, motions, factors, eliminated)
        prior = with_variances(prior, *factor)
        total *= factor
    np.testing.assert_allclose(np.sqrt(total), sigma, rtol=0.1)


def test_changed_variances_keep_the_density_normalised():
    prior = motion_prior(np.array([[0.5, 0.0, 0.1]]), MotionConfig())
    changed = with_variances(prior, 4.0, 9.0)
    np.testing.assert_allclose(changed.precision[0, 0], prior.precision[0, 0] / [4.0, 4.0, 9.0])
    np.testing.assert_array_equal(changed.precision[0, 1:], prior.precision[0, 1:])
    normaliser = 0.5 * np.log(changed.precision[0]).sum(axis=-1) - 1.5 * np.log(2.0 * np.pi)
    np.testing.assert_allclose(changed.log_scale[0], np.log(prior.share) + normaliser)
