# SPDX-License-Identifier: MIT
"""The calibration of the odometry: its equations against numerical derivatives, and known errors that are found."""

import numpy as np
import pytest

from slam import FilterConfig, refine, se2
from slam.config import MotionConfig
from slam.motion.odometry_model import motion_prior
from slam.refinement._chain_kernels import linearise_step
from slam.refinement.odometry_calibration import SIGMA, OdometryCalibration
from tests.slam.rooms import closed, scan_at

CORRIDOR = closed(np.array([(-1.0, -1.0), (29.0, -1.0), (29.0, 1.2), (-1.0, 1.2)]))
"""30 m long, 2.2 m wide, with nothing in it."""


def chained(motions):
    """Poses (n + 1, 3) after motions (n, 3), from the origin."""
    poses = np.zeros((len(motions) + 1, 3))
    for k, motion in enumerate(motions):
        poses[k + 1] = se2.compose(poses[k], motion)
    return poses


def cost(calibration, precision, poses, values):
    """Half the squared errors of all steps, where no step failed, and the prior's part."""
    calibration.values = np.asarray(values)
    guess, e, A, B = np.empty(3), np.empty(3), np.zeros((3, 3)), np.zeros((3, 3))
    total = 0.5 * np.sum((calibration.values / SIGMA) ** 2)
    for t, motion in enumerate(calibration.motions()):
        linearise_step(poses[t], poses[t + 1], motion, guess, e, A, B)
        total += 0.5 * np.sum(precision[t] * e**2)
    return total


def derivative(function, at, k, j=None, step=1e-5):
    """Central difference of a function of an array by its component k, and by j besides."""
    if j is not None:
        return derivative(lambda x: derivative(function, x, k, step=step), at, j, step=step)
    unit = np.zeros_like(at)
    unit.flat[k] = step
    return (function(at + unit) - function(at - unit)) / (2.0 * step)


@pytest.mark.parametrize("seed", range(3))
def test_equations_are_derivatives_of_the_cost(seed):
    rng = np.random.default_rng(seed)
    motions = rng.normal(scale=(0.3, 0.1, 0.3), size=(4, 3))
    calibration = OdometryCalibration(motions)
    sure = MotionConfig(failure_share=1e-9, jump_share=1e-9)
    prior = motion_prior(motions, sure)
    precision = prior.precision[:, 0]
    values = rng.normal(scale=0.03, size=3)
    calibration.values = values
    poses = chained(calibration.motions())  # without an error, so that the equations are exact
    found = calibration.equations(prior, poses)

    def of(x):
        return cost(calibration, precision, x[:-3].reshape(poses.shape), x[-3:])

    at, n = np.concatenate([poses.ravel(), values]), poses.size
    for j in range(3):
        assert found.gradient[j] == pytest.approx(derivative(of, at, n + j), rel=1e-4, abs=1e-2)
        for k in range(3):
            assert found.precision[j, k] == pytest.approx(derivative(of, at, n + j, n + k), rel=1e-3, abs=1.0)
        for k in range(n):
            assert found.coupling.reshape(n, 3)[k, j] == pytest.approx(derivative(of, at, k, n + j), rel=1e-3, abs=1.0)


def test_what_is_taken_from_the_poses_is_the_schur_complement():
    rng = np.random.default_rng(5)
    motions = rng.normal(scale=0.2, size=(5, 3))
    calibration = OdometryCalibration(motions)
    found = calibration.equations(motion_prior(motions, MotionConfig()), chained(motions))
    taken, C = found.taken_from_poses().reshape(-1, 3), found.coupling.reshape(-1, 3)
    expected = C @ np.linalg.solve(found.precision, C.T)
    np.testing.assert_allclose(taken @ taken.T, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_noise_of_counted_turns_does_not_make_the_factor_smaller():
    """Straight stretches on which the odometry's heading jitters as much as the robot turns in all: a factor on the
    counted turns would make them half of what they are."""
    rng = np.random.default_rng(7)
    steps = np.tile([0.02, 0.0, 0.0], (16_000, 1))
    steps[::100, 2], steps[50::100, 2] = 0.12, -0.08
    poses, measured = chained(steps), steps * (1.0, 1.0, 0.97)
    measured[:, 2] += rng.normal(scale=0.012, size=len(steps)) - 0.01 * steps[:, 0]
    calibration = OdometryCalibration(measured)
    prior = motion_prior(measured, MotionConfig(failure_share=1e-9, jump_share=1e-9, rotation_from_rotation=0.0))
    for _ in range(6):  # as in the rounds of the adjustment, but with poses that are known
        calibration.follow(poses)
        found = calibration.equations(prior, poses)
        calibration.move(-np.linalg.solve(found.precision, found.gradient))
    assert calibration.values[1] == pytest.approx(1.0 / 0.97 - 1.0, abs=0.02)
    assert calibration.values[2] == pytest.approx(0.01 / 0.97, abs=0.02)


def long_drive(seed, errors):
    """Truth and final pass of a drive through the corridor; its ends are seen from 8 m, the middle is blind.

    errors (3,): what distance and rotation are too large by, as shares, and the drift [rad/m]
    """
    rng = np.random.default_rng(seed)
    steps = np.tile([0.2, 0.0, 0.0], (140, 1))
    steps[::7, 2], steps[3::7, 2] = 0.12, -0.12
    truth = chained(steps)
    distance, rotation, drift = errors
    measured = steps * (1.0 + distance, 1.0 + distance, 1.0 + rotation)
    measured[:, 2] += drift * steps[:, 0]
    odometry = chained(measured + rng.normal(scale=(0.002, 0.001, 0.001), size=steps.shape))
    scans = [scan_at(pose, beams=180, noise=0.01, rng=rng, walls=CORRIDOR) for pose in truth]
    for scan in scans:
        scan.ranges[scan.ranges > 8.0] = np.inf
    return truth, refine(odometry, scans, odometry, FilterConfig(), threads=1)


def test_the_length_of_a_blind_corridor_is_that_of_calibrated_odometry():
    """Odometry that counts 3 % too much, as the approaches to both ends show, makes the corridor 90 cm too long."""
    truth, result = long_drive(0, (0.03, 0.0, 0.0))
    found, sigma = result.odometry_correction[0], result.odometry_correction_sigma[0]
    assert found == pytest.approx(1.0 / 1.03 - 1.0, abs=0.003)
    assert 1e-4 < sigma < 0.004
    length = np.hypot(*(result.poses[-1] - result.poses[0])[:2])
    assert length == pytest.approx(np.hypot(*(truth[-1] - truth[0])[:2]), abs=0.06)
    error = np.sqrt(result.covariances[-1, 0, 0])
    assert 20.0 * sigma < error < 30.0 * sigma  # of 28 m the scans see the ends: it is mostly the calibration's


@pytest.mark.slow
def test_corrections_are_within_what_they_are_said_to_err_by():
    errors = np.array([-0.02, 0.03, 0.01])
    expected = np.array([1.0 / 0.98 - 1.0, 1.0 / 1.03 - 1.0, -0.01 / (0.98 * 1.03)])
    off = []
    for seed in range(6):
        _, result = long_drive(seed, errors)
        off.append((result.odometry_correction - expected) / result.odometry_correction_sigma)
    assert np.sqrt(np.mean(np.square(off), axis=0)).max() < 2.5, off  # 1 where sigma is exact
    assert np.abs(off).max() > 0.1  # and it is not just large
