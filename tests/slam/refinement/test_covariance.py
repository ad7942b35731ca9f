# SPDX-License-Identifier: MIT
"""Covariances of the refined poses, against errors whose distribution is known."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from slam import FilterConfig, refine, se2
from slam.refinement import joint_equations
from slam.refinement._chain_kernels import chain_covariances, factor_chain
from slam.refinement.covariance import pose_covariances
from tests.slam.rooms import drive, noisy_odometry, scan_at

refine_module = sys.modules["slam.refinement.refine"]  # the package's name `refine` is the function
CONFIG = FilterConfig()


def noisy_run(seed, sigma, turned=0.0):
    """Truth and result of a final pass: ranges with noise [m], odometry with noise, the frame turned [rad]."""
    rng = np.random.default_rng(seed)
    truth = drive(30, distance=0.12, turn=0.06)
    odometry = noisy_odometry(truth, rng)
    scans = []
    for pose in truth:
        scan = scan_at(pose, beams=120)
        scans.append(replace(scan, ranges=scan.ranges + rng.normal(scale=sigma, size=scan.ranges.shape)))
    start = se2.compose((0.0, 0.0, turned), truth)
    return truth, refine(odometry, scans, start, CONFIG, threads=1)


def squared_errors(truth, result):
    """Squared errors relative to the first pose, in variances, (frames - 1,)."""
    expected = se2.compose(result.poses[0], se2.between(truth[0], truth))
    error = result.poses - expected
    error[:, 2] = se2.wrap_angle(error[:, 2])
    return np.einsum("ni,nij,nj->n", error[1:], np.linalg.inv(result.covariances[1:]), error[1:])


def test_squared_errors_are_three_variances_over_many_seeds():
    means = [squared_errors(*noisy_run(seed, sigma=0.02)).mean() for seed in range(16)]
    assert 1.5 < np.mean(means) < 4.5, means  # 3 where the covariance is exact; 16 means scatter by 0.5


def test_covariances_are_relative_to_the_first_pose_and_positive():
    _, result = noisy_run(0, sigma=0.02)
    np.testing.assert_array_equal(result.covariances[0], 0.0)
    assert np.linalg.eigvalsh(result.covariances[1:]).min() > 0.0
    np.testing.assert_allclose(result.covariances, result.covariances.swapaxes(1, 2), atol=1e-15)


def test_covariances_turn_with_the_frame():
    _, straight = noisy_run(3, sigma=0.02)
    _, turned = noisy_run(3, sigma=0.02, turned=np.pi / 2.0)
    R = se2.rotation(np.array(np.pi / 2.0))
    expected = R @ straight.covariances @ R.T
    largest = np.abs(expected).max(axis=(1, 2), keepdims=True)[1:]
    assert np.median(np.abs(turned.covariances - expected)[1:] / largest) < 0.05  # walls meet other cells


def test_covariances_are_along_the_axes_of_the_result(monkeypatch):
    """The first pose comes into step with the others by a turn; then everything is turned back to where it was."""
    kept, given = [], np.diag([4.0, 1.0, 1.0])
    monkeypatch.setattr(refine_module, "pose_covariances", lambda e: kept.append(e) or np.tile(given, (17, 1, 1)))
    truth = drive(16, distance=0.15, turn=0.08)
    initial = truth.copy()
    initial[0, 2] += 0.03
    result = refine(truth, [scan_at(pose, beams=120) for pose in truth], initial, CONFIG, threads=1)
    turn = result.poses[0, 2] - kept[0].poses[0, 2]
    assert abs(turn) > 0.02
    R = se2.rotation(np.array(turn))
    np.testing.assert_allclose(result.covariances[5], R @ given @ R.T, atol=1e-12)


def test_more_noise_makes_less_certain():
    exact, noisy = (noisy_run(1, sigma)[1].covariances[1:] for sigma in (0.01, 0.08))
    assert np.median(noisy[:, 0, 0] / exact[:, 0, 0]) > 2.0


def test_deviations_that_persist_make_less_certain(monkeypatch):
    """Twenty times the deviations of scans from each surfel, with one sign: scans do not err independently there."""
    kept = []
    monkeypatch.setattr(refine_module, "pose_covariances", lambda e: kept.append(e) or pose_covariances(e))
    noisy_run(2, sigma=0.02)
    (equations,) = kept
    seen = equations.observations
    zero, usual, persistent = (
        pose_covariances(equations._replace(observations=seen._replace(residual=residual)))[-1]
        for residual in (0.0 * seen.residual, seen.residual, 20.0 * np.abs(seen.residual))
    )
    assert np.trace(persistent) > 4.0 * np.trace(usual)
    assert np.trace(usual) >= (1.0 - 1e-9) * np.trace(zero) > 0.9 * np.trace(usual)  # never surer than the model


@pytest.mark.parametrize("at_once", [1, 7, 100])
def test_scans_may_be_projected_a_part_at_a_time(monkeypatch, at_once):
    kept = []
    monkeypatch.setattr(refine_module, "pose_covariances", lambda e: kept.append(e) or pose_covariances(e))
    noisy_run(4, sigma=0.02)
    assert kept[0].observations.first[-1] > 100
    whole = pose_covariances(kept[0])
    monkeypatch.setattr(joint_equations, "OBSERVATIONS_AT_ONCE", at_once)
    np.testing.assert_allclose(pose_covariances(kept[0]), whole, rtol=1e-7, atol=1e-15)


@pytest.mark.parametrize("n", [1, 2, 7])
def test_blocks_of_the_inverse_of_a_chain(n):
    rng = np.random.default_rng(n)
    root = rng.normal(size=(n, 3, 3))
    diagonal = root @ root.swapaxes(1, 2) + 5.0 * np.eye(3)
    coupling = rng.normal(size=(max(n - 1, 0), 3, 3))
    dense = np.zeros((n, 3, n, 3))
    for i in range(n):
        dense[i, :, i] = diagonal[i]
    for i in range(n - 1):
        dense[i, :, i + 1], dense[i + 1, :, i] = coupling[i], coupling[i].T
    factors, eliminated, out = np.empty((n, 3, 3)), np.empty((max(n - 1, 0), 3, 3)), np.empty((n, 3, 3))
    assert factor_chain(diagonal, coupling, factors, eliminated)
    chain_covariances(factors, eliminated, out)
    inverse = np.linalg.inv(dense.reshape(3 * n, 3 * n)).reshape(n, 3, n, 3)
    np.testing.assert_allclose(out, [inverse[i, :, i] for i in range(n)], atol=1e-12)
