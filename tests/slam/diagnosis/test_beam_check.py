# SPDX-License-Identifier: MIT
"""Beams against a map with known walls: which of them meet, cross, fall short, or end where nothing is known."""

import numpy as np
import pytest

from slam import se2
from slam.diagnosis.beam_check import MAX_BEAMS, BeamEvidence, check_beams, check_scan
from slam.sensor.rays import make_rays
from tests.slam.rooms import drive, empty_maps, rays, scan_at

HERE = np.zeros(3)


@pytest.fixture(scope="module")
def room():
    """Map of the room, drawn from twelve exact poses."""
    maps = empty_maps()
    for pose in drive(11, distance=0.05, turn=0.2):
        maps.integrate_scan(pose[None], make_rays([scan_at(pose, beams=360)], usable_range=80.0))
    return maps


def wall_at(x, *, scans=4):
    """Map of a robot at the origin that has seen a wall across its way at `x` [m], and the floor up to it."""
    maps = empty_maps()
    ends = np.column_stack([np.full(61, x), np.linspace(-1.5, 1.5, 61)])
    for _ in range(scans):
        maps.integrate_scan(HERE[None], rays(ends))
    return maps


def compare(maps, ends, **more):
    return check_beams(maps, 0, HERE, rays(ends), every=1, **more)[0]


def test_a_scan_at_its_true_pose_meets_the_map(room):
    pose = np.array([0.3, 0.1, 0.4])
    found, _ = check_scan(room, 0, pose, make_rays([scan_at(pose, beams=180)], usable_range=80.0))
    assert found.met >= 0.98 * 90
    assert found.contradicting == 0


@pytest.mark.parametrize("degrees", [25.0, 60.0, 150.0])
def test_a_scan_at_a_turned_pose_contradicts_it(room, degrees):
    pose = np.array([0.3, 0.1, 0.4])
    scan = make_rays([scan_at(pose, beams=180)], usable_range=80.0)
    found, _ = check_scan(room, 0, se2.compose(pose, (0.0, 0.0, np.radians(degrees))), scan)
    assert found.contradicting > 0.3 * found.judged


def test_beams_to_a_wall_through_it_short_of_it_and_elsewhere():
    maps = wall_at(3.0)
    assert compare(maps, [(3.0, 0.0), (3.1, 0.5)]) == BeamEvidence(met=2, through=0, short=0, unknown=0)
    assert compare(maps, [(5.0, 0.0)]) == BeamEvidence(met=0, through=1, short=0, unknown=0)
    assert compare(maps, [(2.0, 0.0)]) == BeamEvidence(met=0, through=0, short=1, unknown=0)
    assert compare(maps, [(-2.0, 0.0)]) == BeamEvidence(met=0, through=0, short=0, unknown=1)


def test_an_end_within_the_clearance_of_a_wall_meets_it():
    maps = wall_at(3.0)
    ends = [(2.75, 0.0), (3.25, 0.0), (2.6, 0.0), (3.4, 0.0)]
    assert compare(maps, ends) == BeamEvidence(met=2, through=1, short=1, unknown=0)


@pytest.mark.parametrize(("start", "end"), [((2.5, -1.4), (3.2, 1.8)), ((2.9, -0.5), (3.5, 1.3))])
def test_a_beam_that_grazes_a_wall_does_not_cross_it(start, end):
    """It ends 20 cm behind the line of the wall, or starts 10 cm before it, and crosses it far from its ends."""
    maps = wall_at(3.0)
    assert check_beams(maps, 0, HERE, rays([end], origin=start), every=1)[0].through == 0
    steeper = (end[0] + 0.3, end[1]), (start[0] - 0.3, start[1])
    assert check_beams(maps, 0, HERE, rays([steeper[0]], origin=steeper[1]), every=1)[0].through == 1


def test_a_wall_seen_once_or_twice_contradicts_nobody():
    """A person who stood there for two scans."""
    ends = np.column_stack([np.full(61, 3.0), np.linspace(-0.3, 0.3, 61)])
    maps = empty_maps()
    maps.integrate_scan(HERE[None], rays(ends[::10]))
    assert compare(maps, [(5.0, 0.0)]).through == 0


def test_readings_without_a_hit_are_not_compared():
    maps = wall_at(3.0)
    found, _ = check_beams(maps, 0, HERE, rays([(5.0, 0.0), (5.0, 0.1)], hit=[False, True]), every=1)
    assert found == BeamEvidence(met=0, through=1, short=0, unknown=0)


def test_every_kth_beam_from_the_first_on():
    maps = wall_at(3.0)
    ends = [(3.0, 0.0), (5.0, 0.0)] * 3
    assert compare(maps, ends).met == 3
    assert check_beams(maps, 0, HERE, rays(ends), every=2)[0].met == 3
    assert check_beams(maps, 0, HERE, rays(ends), every=2, first=1)[0].through == 3


def test_no_more_beams_than_the_limit_are_compared(room):
    for beams in (89, 90, 91, 1081):
        scan = make_rays([scan_at(HERE, beams=beams)], usable_range=80.0)
        assert sum(check_scan(room, 0, HERE, scan)[0]) <= MAX_BEAMS


def test_beams_beyond_the_map_are_unknown_and_change_nothing(room):
    before = room.state()
    far, _ = check_scan(room, 0, np.array([300.0, -400.0, 1.0]), rays(np.full((20, 2), 50.0)))
    assert far == BeamEvidence(met=0, through=0, short=0, unknown=20)
    for name, array in room.state().items():
        np.testing.assert_array_equal(array, before[name])


def test_an_empty_map_says_nothing():
    assert check_scan(empty_maps(), 0, HERE, rays([(1.0, 0.0)]))[0].unknown == 1
