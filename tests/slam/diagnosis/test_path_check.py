# SPDX-License-Identifier: MIT
"""Paths through a known room: true ones are plausible, broken ones are not, and the better one has the better score."""

import numpy as np
import pytest

from slam import FilterConfig, GMapping, se2
from slam.config import MapConfig
from slam.diagnosis.contradiction import JUMP_M
from slam.diagnosis.path_check import check_path, left_out_score
from slam.diagnosis.wheel_speed import WheelNews
from slam.sensor.rays import make_rays
from tests.slam.rooms import drive, scan_at

TRUE = drive(60, distance=0.08, turn=0.11)
STAMPS = np.arange(len(TRUE)) + 100.0
RNG = np.random.default_rng(3)
RAYS = [make_rays([scan_at(pose, beams=180, noise=0.01, rng=RNG)], usable_range=80.0) for pose in TRUE]


def check(poses, odometry=TRUE):
    return check_path(STAMPS, poses, odometry, RAYS, [WheelNews()] * len(RAYS), FilterConfig())


def turned_from(scan, degrees):
    """The true path, turned on the spot at a scan: what a slip makes of it that goes unnoticed."""
    poses = TRUE.copy()
    turn = se2.compose(TRUE[scan], (0.0, 0.0, np.radians(degrees)))
    poses[scan:] = se2.compose(turn, se2.between(TRUE[scan], TRUE[scan:]))
    return poses


def test_the_true_path_is_plausible():
    monitor = check(TRUE)
    assert monitor.overall.verdict == "plausible"
    assert monitor.max_total == 0.0


@pytest.mark.parametrize("degrees", [20.0, 45.0, -80.0])
def test_a_path_with_a_slip_is_lost_from_there(degrees):
    poses = turned_from(30, degrees)
    found = check(poses, odometry=poses).overall
    assert found.verdict == "lost"
    assert found.stamp == STAMPS[30]
    np.testing.assert_allclose(found.place, poses[30])


def test_the_check_does_not_depend_on_the_frame_of_the_odometry():
    poses = turned_from(30, 45.0)
    moved = se2.compose((3.0, -7.0, 1.1), TRUE)
    assert check(poses, odometry=moved).overall == check(poses).overall


def test_a_jump_to_where_nothing_is_known_is_needless():
    """The wheels are right, the map agrees with them, and the estimate leaves both for unknown space."""
    poses = TRUE.copy()
    poses[40:, 0] += 50.0
    found = check(poses).overall
    assert found.verdict == "doubtful"
    assert found.stamp == STAMPS[40]
    assert f"jumps by {50.0:.2f} m" in found.reason


def test_a_jump_that_the_scans_ask_for_is_not_needless():
    """The wheels slip at scan 30, and the estimate is right all the same."""
    assert JUMP_M < 0.6
    slipped = turned_from(30, 60.0)
    assert check(TRUE, odometry=slipped).overall.verdict == "plausible"


def test_the_better_path_has_the_better_score():
    rng = np.random.default_rng(0)
    scores = [
        left_out_score(TRUE + rng.normal(0.0, 1.0, TRUE.shape) * (sigma, sigma, 0.5 * sigma), RAYS, MapConfig())
        for sigma in (0.0, 0.02, 0.05, 0.1, 0.3)
    ]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] > left_out_score(turned_from(30, 20.0), RAYS, MapConfig())


def test_a_score_of_no_beams_is_none():
    assert left_out_score(TRUE[:0], [], MapConfig()) is None


def test_parts_of_several_lengths_are_refused():
    with pytest.raises(ValueError, match="of one length, got 61, 60, 61, 61, 61"):
        check_path(STAMPS, TRUE[:-1], TRUE, RAYS, [WheelNews()] * len(RAYS), FilterConfig())


def test_the_filter_reports_its_check_at_each_scan():
    """The wheels report a turn of 100 degrees that is not made, and the filter takes no jump for possible."""
    config = FilterConfig(particles=3)
    mapper, reports = GMapping(config, seed=0, threads=1), []
    for pose, stamp in zip(TRUE[:30], STAMPS, strict=False):
        reports.append(mapper.process(pose, scan_at(pose, beams=180, stamp=stamp)))
    assert {report.self_check.verdict for report in reports} == {"plausible"}
    used = [report for report in reports if report.updated]
    assert used[0].beams is None
    assert all(report.beams.judged > 60 for report in used[1:])
    for pose, stamp in zip(TRUE[:30], STAMPS[30:], strict=False):  # another room from here on: this one, mirrored
        scan = scan_at(pose, beams=180, stamp=stamp)
        mirrored = type(scan)(ranges=scan.ranges[::-1].copy(), angles=scan.angles, range_max=20.0, stamp=stamp)
        reports.append(mapper.process(se2.compose(TRUE[29], pose), mirrored))
    assert reports[-1].self_check.verdict != "plausible"
    assert mapper.self_check.verdict == "lost"
    assert mapper.self_check.stamp >= STAMPS[30]
