# SPDX-License-Identifier: MIT
"""Beams that do not end on a wall are counted as the simulator makes them."""

import numpy as np
import pytest

from testbed.presets import load_lidar
from testbed.simulation.robot._lidar_kernels import read_beams
from testbed.simulation.robot.lidar import LidarLayers, optics_of
from testbed.twin.returns import returns_of

BEAMS = 40_000


def read(**changes):
    """Readings of walls 1 to 12 m away, and these distances [m], (BEAMS,) each."""
    rng, walls = np.random.default_rng(3), np.random.default_rng(4).uniform(1.0, 12.0, BEAMS)
    lidar = load_lidar("lms200").model_copy(update={"range_max": 80.0, "dropout": 0.0, **changes})
    optics = optics_of(lidar, LidarLayers(bias=False, mixed_pixels=False, grazing=False))
    uniform, normal = rng.uniform(size=(2, BEAMS)), rng.normal(size=BEAMS)
    readings = read_beams(walls, np.ones(BEAMS), uniform, normal, optics, np.array([0.0, 1.0]))
    return np.where(np.isfinite(readings), readings, np.nan), walls


def test_rates_are_those_that_were_simulated():
    found = returns_of(*read(short_return_rate=0.01, dropout=0.03))
    assert found.short_rate == pytest.approx(0.01, rel=0.1)
    assert found.lost == pytest.approx(0.03, rel=0.1)


def test_a_lidar_that_always_sees_the_wall_has_none():
    assert returns_of(*read(short_return_rate=0.0)) == (0.0, 0.0)


def test_walls_at_wrong_places_are_no_readings_in_front():
    """As many lie in front of them as beyond."""
    readings, walls = read(short_return_rate=0.0)
    walls = walls + np.where(np.arange(BEAMS) % 20 == 0, np.where(np.arange(BEAMS) % 40 == 0, 0.5, -0.5), 0.0)
    assert returns_of(readings, walls).short_rate == pytest.approx(0.0, abs=1e-4)


def test_beams_without_a_wall_in_reach_do_not_count():
    assert returns_of(np.full(5, np.nan), np.full(5, np.inf)) == (0.0, 0.0)
