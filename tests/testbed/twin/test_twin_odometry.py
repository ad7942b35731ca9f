# SPDX-License-Identifier: MIT
"""Errors of odometry are found as they were set, whatever errors the path has."""

import math
from dataclasses import replace

import numpy as np
import pytest

from slam import se2
from testbed.presets import load_robot
from testbed.simulation import OdometryConfig
from testbed.simulation.robot.odometry import Odometry
from testbed.twin.odometry import MIN_PIECES, estimate_odometry, find_lead

ROBOT = load_robot("create3")
SET = OdometryConfig(
    systematic=False,
    ticks=False,
    random_translation=0.02,
    random_rotation=math.radians(0.8),
    distance_scale=1.03,
    rotation_scale=0.96,
    drift=math.radians(-0.7),
)


def drive(config, steps=16_000, seed=0, back=False):
    """Odometry and true path (steps + 1, 3) of some 800 m of bends, with turns on the spot between them; `back`: and
    with two metres backward now and then."""
    rng = np.random.default_rng(seed)
    odometry, pose, wheels = Odometry(ROBOT, config, rng), np.zeros(3), np.zeros(2)
    believed, path = [odometry.pose], [pose]
    bends = np.repeat(rng.uniform(-1.0, 1.0, steps // 40), 40)
    for k in range(steps):
        step, turn = (0.05, 0.05 * bends[k]) if k % 400 < 360 else (0.0, 0.1)
        if back and 100 <= k % 1000 < 140:
            step, turn = -step, -turn
        middle = pose[2] + 0.5 * turn
        pose = pose + np.array([step * math.cos(middle), step * math.sin(middle), turn])
        half = 0.5 * turn * ROBOT.track
        wheels = wheels + np.array([step - half, step + half]) / ROBOT.wheel_radius
        believed.append(odometry.advance(*wheels.tolist()))
        path.append(pose)
    return np.array(believed), np.array(path)


@pytest.mark.parametrize("path_noise", [0.0, 1.0])
def test_scales_and_noise_are_those_that_were_set(path_noise):
    """The path's own errors, 1 cm and 0.3 degrees at each pose, are not taken for errors of odometry."""
    odometry, path = drive(SET)
    path = path + path_noise * np.random.default_rng(1).normal(size=path.shape) * [0.01, 0.01, math.radians(0.3)]
    found, pieces = estimate_odometry(odometry[::4], path[::4], track=ROBOT.track)
    assert pieces > 700
    assert found.distance_scale == pytest.approx(SET.distance_scale, abs=0.005)
    assert found.rotation_scale == pytest.approx(SET.rotation_scale, abs=0.005)
    assert found.drift == pytest.approx(SET.drift, abs=math.radians(0.1))
    assert found.random_translation == pytest.approx(SET.random_translation, rel=0.2)
    assert found.random_rotation == pytest.approx(SET.random_rotation, rel=0.2)
    assert found.slip_rate < 0.01
    assert found.recovered_share < 0.2
    assert not found.unsigned


@pytest.mark.parametrize("path_noise", [0.0, 1.0])
def test_errors_of_heading_that_come_back_are_found(path_noise):
    config = replace(SET, random_rotation=math.radians(3.0), recovered_share=0.7, recovery_length=1.2)
    odometry, path = drive(config)
    path = path + path_noise * np.random.default_rng(1).normal(size=path.shape) * [0.01, 0.01, math.radians(0.3)]
    found, _ = estimate_odometry(odometry[::4], path[::4], track=ROBOT.track)
    assert found.random_rotation == pytest.approx(config.random_rotation, rel=0.2)
    assert found.recovered_share == pytest.approx(0.7, abs=0.12)
    assert found.recovery_length == pytest.approx(1.2, rel=0.7)
    assert found.rotation_scale == pytest.approx(SET.rotation_scale, abs=0.01)
    assert found.slip_rate < 0.01


def test_odometry_that_counts_driving_backward_as_forward_is_found():
    """The other errors are found as if nothing had been driven backward."""
    odometry, path = drive(replace(SET, unsigned=True), back=True)
    found, _ = estimate_odometry(odometry[::4], path[::4], track=ROBOT.track)
    assert found.unsigned
    assert found.distance_scale == pytest.approx(SET.distance_scale, abs=0.005)
    assert found.random_translation == pytest.approx(SET.random_translation, rel=0.3)
    assert not estimate_odometry(*drive(SET, back=True), track=ROBOT.track)[0].unsigned


def test_slips_have_the_rate_and_size_that_were_set():
    config = OdometryConfig(systematic=False, ticks=False, slip_rate=0.1, slip_distance=0.08)
    odometry, path = drive(config)
    found, _ = estimate_odometry(odometry, path, track=ROBOT.track)
    assert found.slip_rate == pytest.approx(0.1, rel=0.35)
    assert found.slip_distance == pytest.approx(0.08, rel=0.35)
    assert found.random_rotation == pytest.approx(config.random_rotation, rel=0.35)
    assert found.rotation_scale == pytest.approx(1.0, abs=0.01)


def test_odometry_without_errors_is_found_to_have_none():
    odometry, path = drive(OdometryConfig(systematic=False, random=False, ticks=False), steps=4000)
    found, _ = estimate_odometry(odometry, path, track=ROBOT.track)
    assert (found.distance_scale, found.rotation_scale) == pytest.approx((1.0, 1.0), abs=1e-3)
    assert found.random_translation < 1e-3
    assert found.random_rotation < 1e-3
    assert found.slip_rate == 0.0


@pytest.mark.parametrize("lead", [-0.2, 0.1])
def test_the_lead_of_a_point_before_the_axle_is_found(lead):
    _, path = drive(SET, steps=4000)
    noise = np.random.default_rng(2).normal(size=path.shape) * [0.005, 0.005, math.radians(0.1)]
    assert find_lead(se2.compose(path, [lead, 0.0, 0.0]) + noise) == pytest.approx(lead, abs=0.01)


def test_a_point_on_the_axle_has_no_lead():
    odometry, path = drive(SET, steps=4000)
    assert find_lead(odometry) == pytest.approx(0.0, abs=1e-3)
    assert find_lead(path) == pytest.approx(0.0, abs=1e-3)


def test_a_drive_too_short_to_tell_gives_no_errors():
    odometry, path = drive(SET, steps=40)
    found, pieces = estimate_odometry(odometry, path, track=ROBOT.track)
    assert pieces < MIN_PIECES
    assert found == OdometryConfig(systematic=False, random=False, ticks=False)


def test_a_robot_that_stands_gives_no_errors():
    poses = np.zeros((500, 3))
    found, pieces = estimate_odometry(poses, poses, track=ROBOT.track)
    assert pieces == 0
    assert found.distance_scale == 1.0
