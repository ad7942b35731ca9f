# SPDX-License-Identifier: MIT
"""Beams that do not end on a wall are counted as the simulator makes them."""

import numpy as np
import pytest

from testbed.presets import load_lidar
from testbed.simulation.robot._lidar_kernels import read_beams
from testbed.simulation.robot.lidar import LidarLayers, optics_of
from testbed.twin.returns import ComparedScan, measure_returns, returns_of, thinned

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


def compared(readings, due):
    """A scan from the origin with beams to the left, (beams,) each."""
    return ComparedScan(np.zeros(2), np.linspace(0.0, 1.0, len(due)), np.array(readings), np.array(due))


def test_what_is_off_the_walls_is_kept():
    """Near the wall, before it, beyond it, no return, lost; where no wall is due: nothing seen, and something."""
    scan = compared([5.05, 4.6, 5.4, np.inf, np.nan, np.inf, 7.0], [5.0, 5.0, 5.0, 5.0, 5.0, np.inf, np.inf])
    beams, _ = measure_returns(iter([scan]), np.zeros(1), np.zeros(1))
    assert np.array_equal(beams.ranges, [4.6, 5.4, np.inf, np.nan, 7.0], equal_nan=True)
    assert np.array_equal(beams.directions, scan.directions[[1, 2, 3, 4, 6]])


def test_each_scan_of_the_twin_sees_what_was_seen_at_the_nearest_time():
    """Stamps of a log may step back; its scans are one metre more each."""
    recorded = np.array([0.0, 2.0, 1.0])
    scans = [compared([1.0 + k, 9.0], [9.0, 9.0]) for k in range(3)]
    beams, _ = measure_returns(iter(scans), recorded, np.array([-1.0, 0.4, 0.6, 1.6, 5.0]))
    assert beams.stamps.tolist() == [-1.0, 0.4, 0.6, 1.6, 5.0]
    assert beams.ranges.tolist() == [1.0, 1.0, 3.0, 2.0, 2.0]


def test_a_scan_whose_beams_all_end_on_walls_has_none():
    beams, rates = measure_returns(iter([compared([2.0, 2.0], [2.0, 2.05])]), np.zeros(1), np.zeros(1))
    assert len(beams.stamps) == 0
    assert rates == (0.0, 0.0)


def test_scans_are_thinned_evenly():
    assert thinned(np.arange(5), 3000).tolist() == [0, 1, 2, 3, 4]
    assert thinned(np.arange(9000), 3000).tolist() == list(range(0, 9000, 3))
