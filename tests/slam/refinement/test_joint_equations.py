# SPDX-License-Identifier: MIT
"""The equations of poses and calibration together, against dense ones."""

import numpy as np
import pytest

from slam import se2
from slam._threads import Threads
from slam.config import RefineConfig
from slam.refinement.bundle_adjustment import Adjustment
from slam.refinement.surfels import make_cloud
from slam.sensor.rays import make_rays
from tests.slam.refinement.test_chain import dense_matrix
from tests.slam.rooms import drive, noisy_odometry, scan_at


def solved(seed):
    """The equations of one round of a short drive, every second frame of which has a scan."""
    rng = np.random.default_rng(seed)
    truth = drive(12, distance=0.2, turn=0.1)
    with_scan = np.arange(0, 13, 2)
    seen = [make_rays([scan_at(truth[k], beams=90, noise=0.01, rng=rng)], usable_range=20.0) for k in with_scan]
    odometry = noisy_odometry(truth, rng)
    adjustment = Adjustment(odometry, make_cloud(seen, 10**6), with_scan, RefineConfig(), Threads(1))
    step = adjustment.step(truth + rng.normal(scale=0.01, size=truth.shape), 0.1)
    return adjustment, step


def dense(joint):
    """The whole matrix, (3 frames + 3, 3 frames + 3)."""
    e = joint.equations
    n, seen = len(e.poses), e.observations
    H = dense_matrix(e.diagonal, e.coupling)
    B = np.zeros((3 * n, len(e.normal)))
    frame = np.repeat(e.with_scan, np.diff(seen.first))
    for k, unknown in enumerate(seen.surfel):
        B[3 * frame[k] : 3 * frame[k] + 2, unknown] += seen.weight[k] * e.normal[unknown]
        B[3 * frame[k] + 2, unknown] += seen.heading_jacobian[k]
    used = e.total > 0.0
    C = e.calibration.coupling.reshape(3 * n, 3)
    return np.block([[H - (B[:, used] / e.total[used]) @ B[:, used].T, C], [C.T, e.calibration.precision]])


@pytest.mark.parametrize("seed", range(3))
def test_the_solution_is_that_of_the_dense_equations(seed):
    adjustment, _ = solved(seed)
    right = np.random.default_rng(seed).normal(size=(14, 3))
    expected = np.linalg.solve(dense(adjustment.solved), -right.ravel()).reshape(14, 3)
    found = adjustment.solved.solve(right)
    # relative to the first pose: nothing but the weak gauge holds the whole
    np.testing.assert_allclose(found[:-1] - found[0], expected[:-1] - expected[0], atol=1e-4 * np.abs(expected).max())
    np.testing.assert_allclose(found[-1], expected[-1], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_the_covariance_of_the_calibration_is_a_block_of_the_inverse(seed):
    adjustment, _ = solved(seed)
    expected = np.linalg.inv(dense(adjustment.solved))[-3:, -3:]
    np.testing.assert_allclose(adjustment.solved.calibration_covariance(), expected, rtol=1e-3, atol=1e-9)


def test_a_step_moves_poses_and_calibration_to_the_least_cost():
    """Without noise of the scans nothing is left of a second step."""
    truth = drive(10, distance=0.2, turn=0.1)
    seen = [make_rays([scan_at(pose, beams=90)], usable_range=20.0) for pose in truth]
    motions = se2.between(truth[:-1], truth[1:])
    odometry = np.zeros_like(truth)
    for k, motion in enumerate(motions * (1.02, 1.02, 1.0)):
        odometry[k + 1] = se2.compose(odometry[k], motion)
    adjustment = Adjustment(odometry, make_cloud(seen, 10**6), np.arange(11), RefineConfig(), Threads(1))
    poses = truth.copy()
    for _ in range(4):
        poses = poses + adjustment.step(poses, 0.05)
    assert adjustment.calibration.values[0] == pytest.approx(1.0 / 1.02 - 1.0, abs=0.004)
