# SPDX-License-Identifier: MIT
"""Scans that a slipping wheel has bent, and the motion by the path."""

from dataclasses import replace

import numpy as np
import pytest

from slam import FilterConfig, Scan, refine, se2
from slam.refinement.bent_scans import Sweeps, between_neighbours, misplaced_scans, path_twists
from slam.refinement.scan_frames import ScanLayout
from slam.sensor.deskew import exp_twist
from tests.slam.rooms import scan_at

SWEEP, PERIOD = 0.1, 0.05
VELOCITY = np.array([0.4, 0.0, 0.3])


def drive(frames):
    """Stamps (n,) and poses (n, 3) of a robot at constant velocity."""
    stamps = PERIOD * np.arange(frames)
    return stamps, exp_twist(VELOCITY, stamps)


def sweeps_of(frames, wrong):
    """Every second frame has a scan; those numbered `wrong` have a twist of a slipping wheel."""
    frames_with_scan = np.arange(0, frames, 2)
    twists = np.tile(VELOCITY, (len(frames_with_scan), 1))
    twists[wrong] += (0.0, 0.0, 20.0)
    return Sweeps(frames_with_scan, frames_with_scan, np.full(len(frames_with_scan), SWEEP), twists)


@pytest.mark.parametrize("wrong", [[5], [4, 5], [0], [9], [2, 7]])
def test_bent_scans_are_found_and_get_the_velocity_of_the_path(wrong):
    stamps, poses = drive(20)
    poses[2 * np.array(wrong), 2] += 0.15  # their own poses are wrong too
    found = path_twists(sweeps_of(20, wrong), poses, stamps)
    assert list(found) == wrong
    for twist in found.values():
        np.testing.assert_allclose(twist[2], VELOCITY[2], atol=1e-9)
        np.testing.assert_allclose(np.hypot(*twist[:2]), VELOCITY[0], rtol=0.01)


def test_without_slip_nothing_is_bent():
    stamps, poses = drive(20)
    assert path_twists(sweeps_of(20, []), poses, stamps) == {}
    assert path_twists(sweeps_of(4, [0, 1]), poses[:4], stamps[:4]) == {}  # no two that are straight


@pytest.mark.parametrize("period", [0.5, 1.0])
def test_scans_that_are_far_apart_say_nothing_of_the_turn_within_one(period):
    """A robot that stands, turns on the spot by 0.4 rad at 1.5 rad/s while a scan is taken, and stands again."""
    stamps, poses = period * np.arange(20), np.zeros((20, 3))
    poses[9:, 2] = 0.4
    poses[8, 2] = 0.2
    sweeps = sweeps_of(20, [])
    sweeps.twists[:] = 0.0
    sweeps.twists[4, 2] = 1.5
    assert path_twists(sweeps, poses, stamps) == {}


@pytest.mark.parametrize(
    ("wrong", "turned", "found"), [([5], [4], [4]), ([4, 5], [3], [3]), ([5], [], []), ([], [2, 7], [2, 7])]
)
def test_straight_scans_that_lie_turned_are_found(wrong, turned, found):
    """Their wheels reported the right velocity, but they lie 9 degrees off, beside bent ones or alone."""
    stamps, poses = drive(20)
    for number in turned:
        poses[2 * number, 2] += 0.15
    assert misplaced_scans(sweeps_of(20, wrong), np.array(wrong, np.int64), poses, stamps).tolist() == found


def test_a_robot_that_was_turned_is_not_turned_back():
    """Twice in succession the same way: the scan between lies turned against both of its neighbours."""
    stamps, poses = drive(20)
    poses[10:, 2] += 0.3
    poses[12:, 2] += 0.3
    assert misplaced_scans(sweeps_of(20, []), np.empty(0, np.int64), poses, stamps).size == 0


def test_a_robot_that_looks_aside_and_back_is_not_turned_back():
    """Between scans that are seconds apart it has time to."""
    poses, none = np.zeros((20, 3)), np.empty(0, np.int64)
    poses[8, 2] = 0.15
    sweeps = sweeps_of(20, [])
    sweeps.twists[:] = 0.0
    assert misplaced_scans(sweeps, none, poses, 0.5 * np.arange(20)).size == 0
    assert misplaced_scans(sweeps, none, poses, PERIOD * np.arange(20)).tolist() == [4]


def test_a_straight_scan_that_lies_turned_is_put_between_its_neighbours():
    """Each scan is seen from the frame after its own, in the middle of its sweep."""
    stamps, poses = drive(20)
    scans = [
        Scan(ranges=np.ones(2), angles=np.zeros(2), range_max=5.0, stamp=t, time_offsets=np.array([0.0, SWEEP]))
        for t in stamps
    ]
    scans[1::2] = [None] * 10
    layout = ScanLayout(scans, stamps, [VELOCITY] * 20, FilterConfig())
    assert layout.straighten(poses) is None
    wrong = poses.copy()
    wrong[9, 2] += 0.15
    np.testing.assert_allclose(layout.straighten(wrong), poses, atol=1e-3)


def test_poses_of_bent_scans_lie_between_their_neighbours():
    _, poses = drive(20)
    wrong = poses.copy()
    wrong[[9, 10, 11]] += 1.0
    np.testing.assert_allclose(between_neighbours(np.arange(0, 20, 2), np.array([5]), wrong), poses, atol=1e-3)


@pytest.mark.parametrize("turn", [10.0, 20.0])
def test_a_slip_does_not_turn_a_pose_nor_draw_a_wall(turn):
    """Scans taken in motion; in one sweep the wheels report a turn that a robot may make, or one that none makes
    [rad/s], and the path begins 10 degrees off."""
    frames, slipped = 40, 20
    stamps, truth = drive(frames)
    offsets = np.linspace(0.0, SWEEP, 180)
    scans, twists = [], [VELOCITY.copy() for _ in range(frames)]
    for k in range(frames):
        beams = se2.compose(truth[k], exp_twist(VELOCITY, offsets))
        rays = [scan_at(pose, beams=180) for pose in beams]
        ranges = np.array([ray.ranges[i] for i, ray in enumerate(rays)])
        scan = replace(rays[0], ranges=ranges, stamp=stamps[k], time_offsets=offsets)
        scans.append(scan if k % 2 == 0 else None)
    twists[slipped] = VELOCITY + np.array([0.0, 0.0, turn])
    initial, odometry = truth.copy(), truth.copy()
    initial[slipped : slipped + 2, 2] += np.radians(10.0)
    config = FilterConfig()
    config = replace(config, refine=replace(config.refine, close_loops=False))
    result = refine(odometry, scans, initial, config, twists=twists, stamps=stamps, threads=1)
    error = se2.wrap_angle(result.poses[:, 2] - truth[:, 2])
    assert np.degrees(np.abs(error)).max() < 0.5
    straight = refine(odometry, scans, truth, config, twists=[VELOCITY] * frames, stamps=stamps, threads=1)
    assert abs(int(result.map.occupied.sum()) - int(straight.map.occupied.sum())) <= 10
