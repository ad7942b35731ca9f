# SPDX-License-Identifier: MIT
"""Odometry that starts again goes on from where it was, and odometry that does not is not touched."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam import FilterConfig, GMapping, se2
from slam.config import GateConfig
from slam.motion.continuous_odometry import ContinuousOdometry, has_jumped, join_odometry
from tests.slam.rooms import drive, scan_at

PERIOD = 0.1


def stamps_of(poses):
    return PERIOD * np.arange(len(poses))


@given(st.integers(1, 18), st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-3.0, 3.0))
def test_a_driver_that_starts_anywhere_else_changes_no_displacement(at, x, y, theta):
    poses = drive(20)
    restarted = poses.copy()
    restarted[at:] = se2.compose((x, y, theta), se2.between(poses[at], poses[at:]))
    joined = join_odometry(stamps_of(poses), restarted)
    jump = se2.between(restarted[at - 1], restarted[at])
    kept = np.delete(np.arange(20), at - 1)
    np.testing.assert_allclose(
        se2.between(joined[:-1], joined[1:])[kept], se2.between(poses[:-1], poses[1:])[kept], atol=1e-9
    )
    missing = se2.between(joined[at - 1], joined[at])
    np.testing.assert_allclose(missing, 0.0 if has_jumped(jump, PERIOD) else jump, atol=1e-9)


def test_odometry_without_a_jump_passes_bit_by_bit():
    poses = drive(20)
    np.testing.assert_array_equal(join_odometry(stamps_of(poses), poses), poses)
    assert not has_jumped(np.array((5.0, 0.0, 3.0)), 0.0)  # nothing is known of scans without stamps


def test_the_state_goes_on_where_it_was():
    poses = np.concatenate([drive(5), drive(5)])
    whole, first, second = ContinuousOdometry(), ContinuousOdometry(), ContinuousOdometry()
    expected = [whole.update(stamp, pose) for stamp, pose in zip(stamps_of(poses), poses, strict=True)]
    for stamp, pose in zip(stamps_of(poses)[:8], poses[:8], strict=True):
        first.update(stamp, pose)
    second.restore(first.state())
    found = [second.update(stamp, pose) for stamp, pose in zip(stamps_of(poses)[8:], poses[8:], strict=True)]
    np.testing.assert_array_equal(found, expected[8:])
    assert second.jumps == whole.jumps == 1


def test_a_jump_is_reported_once():
    poses, mapper = np.concatenate([drive(12), drive(3)]), GMapping(FilterConfig(particles=2), seed=0, threads=1)
    reports = [
        mapper.process(pose, scan_at(pose, stamp=stamp)) for stamp, pose in zip(stamps_of(poses), poses, strict=True)
    ]
    assert [report.odometry_jumped for report in reports] == [k == 13 for k in range(len(poses))]


@pytest.mark.parametrize("restart", [False, True])
def test_a_filter_follows_a_robot_whose_driver_starts_again(restart):
    truth, rng = drive(12), np.random.default_rng(0)
    odometry = truth.copy()
    if restart:
        odometry[7:] = se2.between(truth[7], truth[7:])  # begins at zero again
    mapper = GMapping(FilterConfig(particles=5, gate=GateConfig(distance=0.0, angle=0.0)), seed=0, threads=1)
    for stamp, reported, pose in zip(stamps_of(truth), odometry, truth, strict=True):
        report = mapper.process(reported, scan_at(pose, beams=180, noise=0.01, rng=rng, stamp=stamp))
    away = se2.between(truth[-1], report.pose)
    assert math.hypot(away[0], away[1]) < 0.06
    assert abs(away[2]) < 0.02


def test_a_filter_follows_a_robot_whose_wheels_count_nothing():
    """Below the gates a scan that does not fit the map is used: the robot moved, whatever the wheels say."""
    truth, rng = drive(14), np.random.default_rng(0)
    odometry = truth.copy()
    odometry[6:10] = truth[6]  # stands still for four scans
    odometry[10:] = se2.compose(truth[6], se2.between(truth[9], truth[10:]))
    mapper = GMapping(FilterConfig(particles=5), seed=0, threads=1)
    reports = [
        mapper.process(reported, scan_at(pose, beams=180, noise=0.01, rng=rng, stamp=stamp))
        for stamp, reported, pose in zip(stamps_of(truth), odometry, truth, strict=True)
    ]
    assert any(report.updated for report in reports[7:10])
    away = se2.between(truth[-1], reports[-1].pose)
    assert math.hypot(away[0], away[1]) < 0.06


def test_a_robot_that_stands_still_needs_no_update():
    mapper, rng = GMapping(FilterConfig(particles=2), seed=0, threads=1), np.random.default_rng(0)
    for pose in drive(5):
        mapper.process(pose, scan_at(pose, beams=180, noise=0.01, rng=rng))
    assert not any(mapper.process(pose, scan_at(pose, beams=180, noise=0.01, rng=rng)).updated for _ in range(20))
