# SPDX-License-Identifier: MIT
"""Loops are found where the robot sees walls again that it has not seen for long."""

import numpy as np
import pytest

from slam import FilterConfig, GMapping
from slam.config import GateConfig
from slam.step.loop_detector import LoopDetector
from tests.slam.rooms import drive, empty_maps, rays, scan_at


def lengths(last_seen_of_scans, distance=1.0):
    """What the detector returns for the scans after the first, `distance` [m] apart."""
    detector = LoopDetector()
    detector.begin()
    return [detector.update(np.asarray(seen), distance) for seen in last_seen_of_scans]


def test_a_loop_is_as_long_as_the_way_since_its_walls_were_last_seen():
    """Twenty scans of new walls each, then the walls of the second scan: the robot drove 20 m since."""
    onward = [np.full(10, scan) for scan in range(1, 21)]
    found = lengths([*onward, np.full(10, 2), np.full(10, 3)])
    assert found[:20] == [0.0] * 20
    assert found[20] == pytest.approx(20.0)
    assert found[21] == 0.0  # the same loop is reported once


def test_few_beams_and_walls_never_seen_close_no_loop():
    onward = [np.full(10, scan) for scan in range(1, 21)]
    assert not any(lengths([*onward, np.array([2, 2] + 8 * [21])]))
    assert any(lengths([*onward, np.array([2, 2, 2] + 7 * [21])]))
    assert not any(lengths([*onward, np.zeros(10, np.int64), np.zeros(0, np.int64)]))


def test_a_second_loop_counts_after_the_robot_has_left_the_first():
    onward = [np.full(10, scan) for scan in range(1, 21)]
    again = [np.full(10, scan) for scan in range(2, 21)]
    away = [np.full(10, 21 + scan) for scan in range(19, 39)]
    found = np.array(lengths([*onward, *again, *away, np.full(10, 30)]))
    np.testing.assert_array_equal(np.flatnonzero(found), [20, 59])


def test_maps_know_which_scan_has_last_seen_a_wall():
    """A beam that ends there sees it, a beam that passes does not."""
    maps = empty_maps()
    near, far = np.array([(1.0, 0.0)]), np.array([(9.0, 0.0)])
    maps.integrate_scan(np.zeros((1, 3)), rays(near))
    maps.integrate_scan(np.zeros((1, 3)), rays(far))
    points = np.concatenate([near, far, [(0.0, 5.0)], [(1e6, -1e6)]])
    np.testing.assert_array_equal(maps.last_seen(points), [1, 2, 0, 0])


def test_a_robot_that_stays_in_one_room_closes_no_loop():
    mapper = GMapping(FilterConfig(particles=2, gate=GateConfig(distance=0.0, angle=0.0)), threads=1)
    reports = [mapper.process(pose, scan_at(pose, beams=90)) for pose in drive(70)]
    assert not any(report.loop_closed for report in reports)
