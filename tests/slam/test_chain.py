# SPDX-License-Identifier: MIT
"""The equations of a whole trajectory: block tridiagonal solve, odometry between neighbours, and the final pass."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import FilterConfig, refine, se2
from slam._chain_kernels import add_odometry_steps, solve_chain
from slam._match_kernels import MotionPrior, motion_cost
from slam.config import MapConfig, MatchConfig, MotionConfig, RefineConfig
from slam.motion import motion_prior
from tests.slam.rooms import drive, scan_at


def dense_matrix(diagonal, coupling):
    n = len(diagonal)
    H = np.zeros((3 * n, 3 * n))
    for i in range(n):
        H[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = diagonal[i]
    for i in range(n - 1):
        H[3 * i : 3 * i + 3, 3 * i + 3 : 3 * i + 6] = coupling[i]
        H[3 * i + 3 : 3 * i + 6, 3 * i : 3 * i + 3] = coupling[i].T
    return H


@given(st.integers(1, 12), st.integers(0, 10**6))
@settings(deadline=None)
def test_chain_solve_equals_a_dense_solve(n, seed):
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
    gradient = rng.normal(size=(n, 3))
    expected = np.linalg.solve(dense_matrix(diagonal, coupling), gradient.ravel()).reshape(n, 3)
    step = np.empty((n, 3))
    solve_chain(diagonal, coupling, gradient.copy(), step)
    np.testing.assert_allclose(step, expected, rtol=1e-6, atol=1e-8)


def trajectory(seed, noise, n=5):
    """Poses (n, 3) and displacements (n - 1, 3) that fit them up to `noise`."""
    rng = np.random.default_rng(seed)
    poses = rng.normal(scale=(3.0, 3.0, 2.0), size=(n, 3))
    motions = se2.between(poses[:-1], poses[1:]) + noise * rng.normal(scale=(0.1, 0.1, 0.05), size=(n - 1, 3))
    return poses, motions


def chain_cost(prior, poses, motions):
    """The cost that `add_odometry_steps` linearises, by the motion model of the filter."""
    guesses = se2.compose(poses[:-1], motions)
    steps = [MotionPrior(prior.precision[t], prior.log_scale[t]) for t in range(len(motions))]
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


CONFIG = FilterConfig(
    map=MapConfig(cell=0.05, field_radius=0.4),
    match=MatchConfig(hit_sigma=0.05, outlier_distance=0.3),
    refine=RefineConfig(rounds=4, iterations=3, hit_sigma=0.05, outlier_distance=0.3),
)


@pytest.mark.parametrize("seed", range(3))
def test_final_pass_mends_a_noisy_path(seed):
    """Exact scans, odometry with noise, a first guess as a filter gives it; every second frame has odometry alone."""
    rng = np.random.default_rng(seed)
    truth = drive(24, distance=0.15, turn=0.08)
    motions = se2.between(truth[:-1], truth[1:]) + rng.normal(scale=(0.01, 0.005, 0.006), size=(24, 3))
    odometry = np.zeros_like(truth)
    for k, motion in enumerate(motions):
        odometry[k + 1] = se2.compose(odometry[k], motion)
    scans = [scan_at(pose, beams=120) if k % 2 == 0 else None for k, pose in enumerate(truth)]
    initial = truth + rng.normal(scale=(0.04, 0.04, 0.02), size=truth.shape)
    initial[0] = truth[0]
    result = refine(odometry, scans, initial, CONFIG, threads=1)
    before, after = (poses - truth for poses in (initial, result.poses))
    assert np.linalg.norm(after[:, :2]) < 0.6 * np.linalg.norm(before[:, :2])
    assert np.linalg.norm(after[:, 2]) < 0.6 * np.linalg.norm(before[:, 2])
    np.testing.assert_allclose(result.poses[0], initial[0], atol=1e-6)  # it defines the frame
    again = refine(odometry, scans, initial, CONFIG, threads=3)
    np.testing.assert_array_equal(again.poses, result.poses)
    np.testing.assert_array_equal(again.map.probability, result.map.probability)


@pytest.mark.parametrize("off", [(0.06, -0.04, 0.0), (0.0, 0.05, 0.03)])
def test_the_first_pose_comes_into_step_with_the_others(off):
    """A filter errs at its first pose as at any other; in the frame of that pose the whole path must be right after."""
    truth = drive(16, distance=0.15, turn=0.08)
    initial = truth.copy()
    initial[0] = se2.compose(truth[0], off)
    result = refine(truth, [scan_at(pose, beams=120) for pose in truth], initial, CONFIG, threads=1)
    np.testing.assert_allclose(result.poses[0], initial[0], atol=1e-9)
    seen_from_first = [se2.between(poses[0], poses) for poses in (initial, truth, result.poses)]
    wrong, right, found = seen_from_first
    assert np.abs(wrong - right)[1:, :2].max() > 0.04
    np.testing.assert_allclose(found, right, atol=0.015)


def test_final_pass_leaves_a_perfect_path_alone():
    truth = drive(6)
    result = refine(truth, [scan_at(pose) for pose in truth], truth, CONFIG, threads=1)
    np.testing.assert_allclose(result.poses, truth, atol=0.01)


def test_final_pass_says_what_does_not_fit():
    scan = scan_at(np.zeros(3))
    with pytest.raises(ValueError, match="one length, got 2, 1, 2"):
        refine(np.zeros((2, 3)), [scan], np.zeros((2, 3)), CONFIG)
    with pytest.raises(ValueError, match="no frame has a scan with a hit"):
        refine(np.zeros((2, 3)), [None, None], np.zeros((2, 3)), CONFIG)
