# SPDX-License-Identifier: MIT
"""Loops are found where the robot sees walls again that it has not seen for long."""

import numpy as np
import pytest

from slam import FilterConfig, GMapping
from slam.config import GateConfig
from slam.step.loop_detector import LoopDetector
from tests.slam.rooms import drive, scan_at


def around(x, count=10):
    """End points on the walls about a place, in squares that no other place shares."""
    return np.column_stack([np.full(count, x + 0.1), 0.4 * np.arange(count) + 0.1])


def lengths(places, distance=1.0):
    """What the detector returns for scans `distance` [m] apart, each of the walls about a place."""
    detector = LoopDetector()
    return [
        detector.update(place if isinstance(place, np.ndarray) else around(float(place)), distance) for place in places
    ]


def test_a_loop_is_as_long_as_the_way_since_its_walls_were_last_seen():
    """Twenty scans of new walls each, then the walls of the second scan again: the robot drove 19 m since."""
    found = lengths([*range(20), 1, 2])
    assert found[:20] == [0.0] * 20
    assert found[20] == pytest.approx(19.0)
    assert found[21] == 0.0  # the same loop is reported once


def test_walls_that_come_into_sight_one_by_one_close_a_loop_together():
    """The robot sees a tenth of the old walls more with each scan: each was seen a moment ago but for the first."""
    old = around(0.0)
    onward = [around(float(x)) for x in range(1, 20)]
    closing = [np.concatenate([old[:k], around(20.0, 10)[k:]]) for k in range(1, 6)]
    found = np.array(lengths([old, *onward, *closing]))
    np.testing.assert_array_equal(np.flatnonzero(found), [22])  # three tenths
    assert found[22] == pytest.approx(20.0, abs=2.0)


def test_few_beams_and_no_beams_close_no_loop():
    few = np.concatenate([around(1.0)[:2], around(30.0)[:8]])
    assert not any(lengths([*range(20), few]))
    assert not any(lengths([*range(20), np.zeros((0, 2))]))


def test_a_second_loop_counts_after_the_robot_has_left_the_first():
    found = np.array(lengths([*range(20), *range(1, 20), *range(40, 60), 50]))
    np.testing.assert_array_equal(np.flatnonzero(found), [20])
    found = np.array(lengths([*range(20), *range(1, 20), *range(40, 60), 41]))
    np.testing.assert_array_equal(np.flatnonzero(found), [20, 59])


def test_the_state_goes_on_where_it_was():
    places = [*range(20), 1, 2, 3]
    first, second = LoopDetector(), LoopDetector()
    for place in places[:15]:
        first.update(around(float(place)), 1.0)
    second.restore(first.state())
    found = [second.update(around(float(place)), 1.0) for place in places[15:]]
    assert found == lengths(places)[15:]


def test_a_robot_that_stays_in_one_room_closes_no_loop():
    mapper = GMapping(FilterConfig(particles=2, gate=GateConfig(distance=0.0, angle=0.0)), threads=1)
    reports = [mapper.process(pose, scan_at(pose, beams=90)) for pose in drive(70)]
    assert not any(report.loop_closed for report in reports)
