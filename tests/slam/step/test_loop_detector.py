# SPDX-License-Identifier: MIT
"""Loops are found where the robot sees walls again that it has not seen for long."""

import json

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
    """What the detector returns for scans `distance` [m] apart, each of the walls about a place; the robot itself is
    always at a new place."""
    detector = LoopDetector()
    found = []
    for number, place in enumerate(places):
        hits = place if isinstance(place, np.ndarray) else around(float(place))
        found.append(detector.update(hits, np.array([0.0, 10.0 * number, 0.0]), distance).length)
    return found


def test_a_loop_is_as_long_as_the_way_since_its_walls_were_last_seen():
    """Twenty scans of new walls each, then the walls of the second scan again: the robot drove 19 m since."""
    found = lengths([*range(20), 1, 2])
    assert found[:20] == [0.0] * 20
    assert found[20] == pytest.approx(19.0)
    assert found[21] == 0.0  # the same loop is reported once


def test_squares_on_all_sides_of_the_origin_are_remembered_as_columns_and_rows():
    detector = LoopDetector()
    detector.update(0.4 * np.array([[-3, -2], [-3, 2], [3, -2], [3, 2], [0, -1]]) + 0.1, np.zeros(3), 0.0)
    assert [entry[:2] for entry in detector.state()["seen"]] == [[-3, -2], [-3, 2], [0, -1], [3, -2], [3, 2]]


def test_walls_that_come_into_sight_one_by_one_close_a_loop_together():
    """The robot sees a tenth of the old walls more with each scan: each was seen a moment ago but for the first."""
    old = around(0.0)
    onward = [around(float(x)) for x in range(1, 20)]
    closing = [np.concatenate([old[:k], around(20.0, 10)[k:]]) for k in range(1, 6)]
    found = np.array(lengths([old, *onward, *closing]))
    np.testing.assert_array_equal(np.flatnonzero(found), [22])  # three tenths
    assert found[22] == pytest.approx(22.0)  # from the old walls' last sight to now


def test_few_beams_and_no_beams_close_no_loop():
    few = np.concatenate([around(1.0)[:2], around(30.0)[:8]])
    assert not any(lengths([*range(20), few]))
    assert not any(lengths([*range(20), np.zeros((0, 2))]))


def test_a_second_loop_counts_after_the_robot_has_left_the_first():
    found = np.array(lengths([*range(20), *range(1, 20), *range(40, 60), 50]))
    np.testing.assert_array_equal(np.flatnonzero(found), [20])
    found = np.array(lengths([*range(20), *range(1, 20), *range(40, 60), 41]))
    np.testing.assert_array_equal(np.flatnonzero(found), [20, 59])


def returns(walls, robots, count=1.0):
    """Scan number, length and kind of the loops that the detector finds, for scans 1 m apart."""
    detector = LoopDetector()
    loops = [
        detector.update(around(float(wall)), np.array([float(robot), 0.0, 0.0]), count)
        for wall, robot in zip(walls, robots, strict=True)
    ]
    return [(number, loop.length, loop.at_place) for number, loop in enumerate(loops) if loop.length]


def test_a_robot_that_is_back_at_a_place_closes_the_longer_loop():
    """It sees the walls of the tenth scan first, and is then back where it began: that loop is the longer one."""
    walls = [*range(30), 10, 10, 10, 0, 0, 1]
    robots = [*range(0, 300, 10), 400, 410, 420, 0, 10, 20]
    assert returns(walls, robots) == [(30, 20.0, False), (33, 33.0, True)]


def test_a_loop_names_the_scan_that_was_there_before():
    """Out over 30 m and back to a place that lies beside the path: the scan that is named was near it."""
    rng, detector = np.random.default_rng(0), LoopDetector()
    out = np.column_stack([np.linspace(0.0, 30.0, 300), np.zeros(300)])
    around_ = np.column_stack([np.linspace(30.0, 10.0, 200), np.full(200, 8.0)])
    back = np.column_stack([np.full(80, 10.3), np.linspace(8.0, 0.3, 80)])
    places = np.concatenate([out, around_, back]) + rng.normal(0.0, 0.01, (580, 2))
    steps = np.hypot(*np.diff(places, axis=0, prepend=places[:1]).T)
    found = []
    for k, (place, step) in enumerate(zip(places, steps, strict=True)):
        loop = detector.update(around(np.floor(place[0])), np.array([*place, 0.0]), step)
        if loop.at_place:
            found.append((k, loop))
    ((k, loop),) = found
    then = k - loop.scans_ago
    assert np.hypot(*(places[k] - places[then])) < 1.1
    assert loop.length == pytest.approx(steps[then + 1 : k + 1].sum(), abs=1.0)


def test_a_robot_is_at_a_place_within_about_a_metre():
    walls = [*range(30), 0]
    assert returns(walls, [*range(0, 300, 10), 0.6])[-1] == (30, 30.0, True)
    assert returns([*range(30), 5], [*range(0, 300, 10), 1.4])[-1] == (30, 25.0, False)


def test_a_place_without_old_walls_closes_no_loop():
    assert returns([*range(30), 40], [*range(0, 300, 10), 0]) == []


def test_a_loop_that_becomes_much_longer_is_told_again():
    """Back along the way that it came, walls and places lie two metres further back with each metre."""
    walls = [*range(40), *range(38, 0, -1)]
    found = returns(walls, walls)
    lengths_found = [length for _, length, _ in found]
    assert lengths_found[0] == pytest.approx(LoopDetector.LOOP, abs=2.0)
    assert np.all(np.diff(lengths_found[1:]) >= LoopDetector.LOOP)
    assert 76.0 - lengths_found[-1] < LoopDetector.LOOP + 2.0


def test_the_state_goes_on_where_it_was():
    walls, robots = [*range(30), 10, 10, 0, 0], [*range(0, 300, 10), 400, 410, 0, 10]
    whole, second = LoopDetector(), LoopDetector()
    found = []
    for number, (wall, robot) in enumerate(zip(walls, robots, strict=True)):
        scan = around(float(wall)), np.array([float(robot), 0.0, 0.0]), 1.0
        found.append(whole.update(*scan))
        if number == 30:  # between the first sight of the old walls and the place
            second.restore(json.loads(json.dumps(whole.state())))
        elif number > 30:
            assert second.update(*scan) == found[-1]
    assert found[-2].at_place


def test_a_robot_that_stays_in_one_room_closes_no_loop():
    mapper = GMapping(FilterConfig(particles=2, gate=GateConfig(distance=0.0, angle=0.0)), threads=1)
    reports = [mapper.process(pose, scan_at(pose, beams=90)) for pose in drive(70)]
    assert not any(report.loop_closed for report in reports)
