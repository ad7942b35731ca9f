# SPDX-License-Identifier: MIT
"""Faults change what they say, at the time they say, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from slam import se2
from slam.scan import Scan
from testbed.frame import Frame
from testbed.stress.perturbations import (
    blind,
    carry,
    limit_range,
    lose_scans,
    restart_odometry,
    reverse_odometry,
    slip,
    space_scans,
    stop_odometry,
    thin_scans,
)


@pytest.fixture
def frames() -> list[Frame]:
    """A robot on a curve for 10 s: a frame each 0.1 s, a scan with each second one."""
    made, pose = [], np.array([1.0, 2.0, 0.3])
    for k in range(100):
        stamp = 0.1 * k
        scan = Scan(ranges=np.full(8, 2.0), angles=np.linspace(-1, 1, 8), range_max=9.0, stamp=stamp)
        twist = np.array([0.5, 0.0, 0.2])
        made.append(Frame(stamp=stamp, odometry=pose, truth=pose, twist=twist, scan=scan if k % 2 == 0 else None))
        pose = se2.compose(pose, [0.05, 0.0, 0.02])
    return made


def test_wheels_that_slip_report_just_the_motion_they_were_told(frames: list[Frame]) -> None:
    changed = list(slip(frames, 4.0, np.array([0.0, 0.0, 1.0])))
    for k in (10, 39, 40):
        np.testing.assert_allclose(changed[k].odometry, frames[k].odometry)
    turned = se2.between(changed[40].odometry, changed[45].odometry)[2]
    assert turned == pytest.approx(se2.between(frames[40].odometry, frames[45].odometry)[2] + 1.0)
    later = se2.between(changed[60].odometry, changed[90].odometry)
    np.testing.assert_allclose(later, se2.between(frames[60].odometry, frames[90].odometry), atol=1e-9)
    assert changed[42].twist[2] == pytest.approx(0.2 + 2.0)
    assert all(a.truth is b.truth and a.scan is b.scan for a, b in zip(changed, frames, strict=True))


def test_a_robot_that_is_carried_is_elsewhere_and_its_wheels_say_nothing(frames: list[Frame]) -> None:
    changed = list(carry(frames, 3.0, 2.0))
    assert len(changed) == 80
    np.testing.assert_allclose(np.diff([f.stamp for f in changed]), 0.1)
    assert changed[30].scan is not None
    assert changed[30].scan.stamp == pytest.approx(changed[30].stamp)
    np.testing.assert_allclose(changed[30].truth, frames[50].truth)
    np.testing.assert_allclose(changed[30].odometry, changed[29].odometry)
    step = se2.between(changed[40].odometry, changed[41].odometry)
    np.testing.assert_allclose(step, [0.05, 0.0, 0.02], atol=1e-9)


def test_a_blind_lidar_sees_nothing_for_its_time(frames: list[Frame]) -> None:
    seen = [bool(f.scan.hit.any()) for f in blind(frames, 2.0, 3.0) if f.scan is not None]
    assert seen == [not 2.0 <= f.stamp < 5.0 for f in frames if f.scan is not None]


def test_scans_are_lost_and_the_wheels_are_not(frames: list[Frame]) -> None:
    changed = list(lose_scans(frames, 2.0, 3.0))
    assert len(changed) == len(frames)
    assert not any(f.scan for f in changed if 2.0 <= f.stamp < 5.0)
    assert sum(f.scan is not None for f in changed) == 35


def test_an_odometry_that_starts_anew_keeps_its_motions(frames: list[Frame]) -> None:
    changed = list(restart_odometry(frames, 5.0))
    np.testing.assert_allclose(changed[50].odometry, 0.0, atol=1e-12)
    np.testing.assert_allclose(
        se2.between(changed[60].odometry, changed[70].odometry),
        se2.between(frames[60].odometry, frames[70].odometry),
        atol=1e-9,
    )
    assert changed[49].odometry is frames[49].odometry


def test_counters_that_stand_still_or_count_backward_do_so_for_their_time(frames: list[Frame]) -> None:
    stopped, reversed_ = list(stop_odometry(frames, 4.0, 2.0)), list(reverse_odometry(frames, 4.0, 2.0))
    np.testing.assert_allclose(se2.between(stopped[41].odometry, stopped[59].odometry), 0.0, atol=1e-12)
    there = se2.between(frames[41].odometry, frames[59].odometry)
    back = se2.between(reversed_[41].odometry, reversed_[59].odometry)
    assert back[2] == pytest.approx(-there[2])
    assert back[0] < 0.0 < there[0]
    for changed in (stopped, reversed_):
        np.testing.assert_allclose(
            se2.between(changed[62].odometry, changed[99].odometry),
            se2.between(frames[62].odometry, frames[99].odometry),
            atol=1e-9,
        )
        np.testing.assert_allclose(changed[30].odometry, frames[30].odometry)
    np.testing.assert_array_equal(stopped[50].twist, 0.0)
    np.testing.assert_array_equal(reversed_[50].twist, -frames[50].twist)


def test_scans_come_no_more_often_than_asked_for(frames: list[Frame]) -> None:
    stamps = [f.stamp for f in thin_scans(frames, 1.0) if f.scan is not None]
    assert len(stamps) == 10
    assert np.diff(stamps).min() >= 1.0 - 1e-9
    assert len(list(thin_scans(frames, 1.0))) == len(frames)


def test_scans_come_no_more_often_than_the_metres_say(frames: list[Frame]) -> None:
    changed = list(space_scans(frames, 0.42))
    places = np.array([0.05 * k for k, frame in enumerate(changed) if frame.scan is not None])  # 5 cm a frame
    assert len(changed) == len(frames)
    np.testing.assert_allclose(np.diff(places), 0.5)  # a scan comes each 0.1 m


def test_a_short_range_turns_what_is_beyond_into_no_returns(frames: list[Frame]) -> None:
    near, far = (next(f.scan for f in limit_range(frames, metres) if f.scan) for metres in (1.5, 3.0))
    assert near.no_return.all()
    assert near.range_max == 1.5
    np.testing.assert_array_equal(far.ranges, 2.0)
