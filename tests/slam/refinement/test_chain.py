# SPDX-License-Identifier: MIT
"""The equations of a whole trajectory: block tridiagonal solve, and odometry between neighbours."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.config import MotionConfig
from slam.motion._odometry_model_kernels import motion_cost
from slam.motion.odometry_model import MotionPrior, motion_prior
from slam.refinement._chain_kernels import add_odometry_steps, factor_chain, multiply_chain, solve_chain


def dense_matrix(diagonal, coupling):
    n = len(diagonal)
    H = np.zeros((3 * n, 3 * n))
    for i in range(n):
        H[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = diagonal[i]
    for i in range(n - 1):
        H[3 * i : 3 * i + 3, 3 * i + 3 : 3 * i + 6] = coupling[i]
        H[3 * i + 3 : 3 * i + 6, 3 * i : 3 * i + 3] = coupling[i].T
    return H


def random_chain(n, seed):
    """A positive definite block tridiagonal matrix, and a right-hand side (n, 3)."""
    rng = np.random.default_rng(seed)
    diagonal, coupling = np.zeros((n, 3, 3)), np.zeros((n - 1, 3, 3))
    for i in range(n):
        root = rng.normal(size=(3, 3))
        diagonal[i] += root @ root.T + 0.1 * np.eye(3)
    for i in range(n - 1):  # as the odometry does: a quadratic form of both neighbours
        J = rng.normal(size=(3, 6))
        diagonal[i] += J[:, :3].T @ J[:, :3]
        diagonal[i + 1] += J[:, 3:].T @ J[:, 3:]
        coupling[i] += J[:, :3].T @ J[:, 3:]
    return diagonal, coupling, rng.normal(size=(n, 3))


@given(st.integers(1, 12), st.integers(0, 10**6))
@settings(deadline=None)
def test_chain_equals_a_dense_matrix(n, seed):
    diagonal, coupling, right = random_chain(n, seed)
    dense = dense_matrix(diagonal, coupling)
    product, x = np.empty((n, 3)), np.empty((n, 3))
    multiply_chain(diagonal, coupling, right, product)
    np.testing.assert_allclose(product.ravel(), dense @ right.ravel(), atol=1e-10)
    factors, eliminated = np.empty((n, 3, 3)), np.empty((n - 1, 3, 3))
    factor_chain(diagonal, coupling, factors, eliminated)
    solve_chain(factors, eliminated, coupling, right, x)
    np.testing.assert_allclose(x.ravel(), np.linalg.solve(dense, right.ravel()), rtol=1e-6, atol=1e-8)


def trajectory(seed, noise, n=5):
    """Poses (n, 3) and displacements (n - 1, 3) that fit them up to `noise`."""
    rng = np.random.default_rng(seed)
    poses = rng.normal(scale=(3.0, 3.0, 2.0), size=(n, 3))
    motions = se2.between(poses[:-1], poses[1:]) + noise * rng.normal(scale=(0.1, 0.1, 0.05), size=(n - 1, 3))
    return poses, motions


def chain_cost(prior, poses, motions):
    """The cost that `add_odometry_steps` linearises, by the motion model of the filter."""
    guesses = se2.compose(poses[:-1], motions)
    steps = [MotionPrior(prior.precision[t], prior.log_scale[t], prior.share) for t in range(len(motions))]
    return sum(motion_cost(steps[t], guesses[t], *poses[t + 1]) for t in range(len(motions)))


def equations(prior, poses, motions):
    n = len(poses)
    diagonal, coupling, gradient = np.zeros((n, 3, 3)), np.zeros((n - 1, 3, 3)), np.zeros((n, 3))
    add_odometry_steps(prior, poses, motions, diagonal, coupling, gradient)
    return dense_matrix(diagonal, coupling), gradient.ravel()


def gradient_by_differences(prior, poses, motions, step=1e-6):
    g = np.empty(poses.size)
    for k in range(poses.size):
        away = np.zeros(poses.size)
        away[k] = step
        away = away.reshape(poses.shape)
        g[k] = (chain_cost(prior, poses + away, motions) - chain_cost(prior, poses - away, motions)) / (2.0 * step)
    return g


@pytest.mark.parametrize("failure_share", [0.0, 0.2])
@pytest.mark.parametrize("seed", range(5))
def test_gradient_of_the_odometry(seed, failure_share):
    poses, motions = trajectory(seed, noise=1.0)
    prior = motion_prior(motions, MotionConfig(failure_share=failure_share))
    np.testing.assert_allclose(
        equations(prior, poses, motions)[1], gradient_by_differences(prior, poses, motions), rtol=1e-5, atol=1e-4
    )


@pytest.mark.parametrize("seed", range(5))
def test_hessian_of_the_odometry_where_it_fits(seed):
    """At zero residuals Gauss-Newton's Hessian is the true one."""
    poses, motions = trajectory(seed, noise=0.0)
    prior = motion_prior(motions, MotionConfig(failure_share=0.0))
    H, g = equations(prior, poses, motions)
    np.testing.assert_allclose(g, 0.0, atol=1e-8)
    step = 1e-5
    columns = []
    for k in range(poses.size):
        away = np.zeros(poses.size)
        away[k] = step
        away = away.reshape(poses.shape)
        ahead, back = (equations(prior, poses + sign * away, motions)[1] for sign in (1.0, -1.0))
        columns.append((ahead - back) / (2.0 * step))
    np.testing.assert_allclose(H, np.array(columns), rtol=1e-4, atol=1e-4 * H.max())
