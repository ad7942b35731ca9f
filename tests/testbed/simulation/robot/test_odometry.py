# SPDX-License-Identifier: MIT
"""Odometry: exact without errors, and errors of the stated size with them."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.presets import load_robot
from testbed.simulation.robot.odometry import GRADES, Odometry, OdometryConfig

ROBOT = load_robot("create3")
NONE = OdometryConfig(systematic=False, random=False, ticks=False)


def wheels(distance, turn):
    """Angles of the wheels [rad] after an arc of that length [m] and angle [rad]."""
    half = 0.5 * turn * ROBOT.track
    return (distance - half) / ROBOT.wheel_radius, (distance + half) / ROBOT.wheel_radius


def path(config, distance, turn, steps, seed=0):
    """All odometry poses along an arc, (steps + 1, 3)."""
    odometry = Odometry(ROBOT, config, np.random.default_rng(seed))
    left, right = wheels(distance, turn)
    readings = [odometry.advance(left * k / steps, right * k / steps) for k in range(1, steps + 1)]
    return np.array([np.zeros(3), *readings])


def drive(config, distance, turn, steps, seed=0):
    """The last odometry pose of an arc, (3,)."""
    return path(config, distance, turn, steps, seed)[-1]


@given(st.floats(-5.0, 5.0), st.floats(-6.0, 6.0), st.integers(1, 20))
@settings(deadline=None)
def test_arcs_are_exact_without_errors(distance, turn, steps):
    x, y, theta = drive(NONE, distance, turn, steps)
    if abs(turn) > 1e-6:
        radius = distance / turn
        expected = (radius * math.sin(turn), radius * (1.0 - math.cos(turn)), turn)
    else:
        expected = (distance, 0.5 * distance * turn, turn)
    assert (x, y, theta) == pytest.approx(expected, abs=1e-6)


@given(st.floats(0.001, 3.0))
@settings(deadline=None)
def test_ticks_lose_less_than_one_tick_of_each_wheel(distance):
    tick = 2.0 * math.pi * ROBOT.wheel_radius / ROBOT.ticks_per_turn
    x, y, theta = drive(dataclasses.replace(NONE, ticks=True), distance, 0.0, 37)
    assert distance - tick - 1e-9 <= x <= distance + 1e-9
    assert abs(y) < tick * distance / ROBOT.track + 1e-9
    assert abs(theta) < tick / ROBOT.track + 1e-9


@pytest.mark.parametrize("steps", [4, 64])
def test_random_errors_do_not_depend_on_the_rate_of_readings(steps):
    config = dataclasses.replace(NONE, random=True)
    straight = np.array([drive(config, 4.0, 0.0, steps, seed) for seed in range(600)])
    assert np.std(straight[:, 0]) == pytest.approx(config.random_translation * 2.0, rel=0.1)
    assert np.std(straight[:, 2]) == pytest.approx(config.random_rotation * 2.0, rel=0.1)
    spin = np.array([drive(config, 0.0, 4.0, steps, seed) for seed in range(600)])
    assert np.std(spin[:, 2]) == pytest.approx(config.random_rotation * 2.0, rel=0.1)
    assert np.abs(spin[:, :2]).max() < 1e-9


def test_a_share_of_the_error_of_heading_is_made_good():
    """Of independent turns a (1 - r) stays and a r decays: the variance after a way s is
    q² s + (a² - q²) length (1 - exp(-s / length)) with q = (1 - r) a."""
    config = dataclasses.replace(NONE, random=True, recovered_share=0.75, recovery_length=0.5)
    headings = np.array([path(config, 12.0, 0.0, 600, seed)[:, 2] for seed in range(400)])
    fast, slow = config.random_rotation**2, (0.25 * config.random_rotation) ** 2
    for way in (0.1, 1.0, 12.0):
        expected = slow * way + (fast - slow) * 0.5 * -math.expm1(-way / 0.5)
        assert np.var(headings[:, round(50 * way)]) == pytest.approx(expected, rel=0.25)


def test_unsigned_encoders_count_driving_backward_as_forward():
    config = dataclasses.replace(NONE, unsigned=True)
    assert drive(config, -2.0, 0.0, 10) == pytest.approx((2.0, 0.0, 0.0))
    assert drive(config, 2.0, 0.0, 10) == pytest.approx((2.0, 0.0, 0.0))
    assert drive(config, -2.0, 0.5, 10)[2] == pytest.approx(0.5)


@pytest.mark.parametrize("grade", GRADES)
def test_grades_scale_distance_and_rotation(grade):
    config = dataclasses.replace(NONE, systematic=True, grade=grade)
    runs = [(drive(config, 1.0, 0.0, 5, seed), drive(config, 0.0, 3.0, 5, seed)) for seed in range(600)]
    distances = np.array([math.hypot(straight[0], straight[1]) for straight, _ in runs])
    turns = np.array([spin[2] for _, spin in runs]) / 3.0
    assert np.std(distances) == pytest.approx(GRADES[grade].distance, rel=0.1)
    assert np.std(turns) == pytest.approx(GRADES[grade].rotation, rel=0.1)
    assert np.mean(distances) == pytest.approx(1.0, abs=4.0 * GRADES[grade].distance / math.sqrt(600))


def test_slip_has_the_stated_rate_and_size():
    """Each event adds half the spin to the path, and turns it; the spin is exponential, so E[s²] = 2 mean²."""
    rate, spin, runs = 0.5, 0.03, 300
    config = dataclasses.replace(NONE, slip_rate=rate, slip_distance=spin)
    paths = np.array([path(config, 10.0, 0.0, 100, seed) for seed in range(runs)])
    events = 100 * -math.expm1(-rate * 0.1)  # at most one in each of the 100 readings
    ahead = np.hypot(*np.diff(paths[:, :, :2], axis=1).transpose(2, 0, 1)).sum(axis=1) - 10.0
    spread = 0.5 * spin * math.sqrt(2.0 * events)
    assert np.mean(ahead) == pytest.approx(0.5 * spin * events, abs=4.0 * spread / math.sqrt(runs))
    assert np.std(ahead) == pytest.approx(spread, rel=0.2)
    assert ahead.min() > -0.005
    assert np.std(paths[:, -1, 2]) == pytest.approx(math.sqrt(2.0 * events) * spin / ROBOT.track, rel=0.2)


def test_lost_ticks_shorten_the_path():
    assert drive(dataclasses.replace(NONE, lost_ticks=0.1), 2.0, 0.0, 10)[0] == pytest.approx(1.8)


def test_scales_and_drift_are_what_odometry_counts():
    config = dataclasses.replace(NONE, distance_scale=1.04, rotation_scale=0.9, drift=0.02)
    assert drive(config, 0.0, 2.0, 10)[2] == pytest.approx(1.8)
    x, y, theta = drive(config, 3.0, 0.0, 10)
    assert theta == pytest.approx(0.06)
    assert math.hypot(x, y) == pytest.approx(2.0 * 3.12 / 0.06 * math.sin(0.03))


def test_switching_one_layer_leaves_the_others_noise_alone():
    both = OdometryConfig(systematic=False, ticks=False)
    slipping = dataclasses.replace(both, slip_rate=1e-9)
    assert np.array_equal(drive(both, 3.0, 1.0, 30), drive(slipping, 3.0, 1.0, 30))


@pytest.mark.parametrize(
    "bad",
    [
        {"grade": "perfect"},
        {"slip_rate": -1.0},
        {"lost_ticks": 1.0},
        {"random_rotation": math.nan},
        {"drift": 2.0},
        {"recovered_share": 1.5},
        {"recovery_length": 0.0},
        {"distance_scale": 0.0},
    ],
)
def test_bad_settings_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        OdometryConfig(**bad)
