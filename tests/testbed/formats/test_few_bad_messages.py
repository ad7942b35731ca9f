# SPDX-License-Identifier: MIT
"""A few messages that make no sense are left out with a note; where there are many, the bag is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.formats import LogError, open_log
from tests.testbed.formats.bags import STORE, assert_like, bag, changed

POINT = STORE.types["geometry_msgs/msg/Point"]
SCAN_FAULTS = {
    "angle_min": ({"angle_min": math.nan}, "angles must be finite"),
    "range_max": ({"range_max": 0.0}, "expected 0 <= range_min < range_max"),
    "increment": ({"angle_increment": 0.1}, "the angles contradict each other"),
}


def every(number: int, change):
    """Change each so manieth message."""
    return lambda message, k: change(message) if k % number == number - 1 else message


@pytest.mark.parametrize(("fault", "reason"), SCAN_FAULTS.values(), ids=SCAN_FAULTS)
def test_few_bad_scans_are_left_out(tmp_path, messages, sound, fault, reason):
    few = bag(tmp_path / "few", changed(messages, "/scan", every(20, lambda scan: replace(scan, **fault))))
    log = open_log(few)
    count = len(sound.scan_rows)
    assert log.scan_count == count - count // 20
    (note,) = [note for note in log.repairs if "scans are left out" in note]
    assert note.startswith(f"{count // 20} of {count} scans are left out: message ")
    assert reason in note
    many = bag(tmp_path / "many", changed(messages, "/scan", every(5, lambda scan: replace(scan, **fault))))
    with pytest.raises(LogError, match=reason):
        open_log(many)


def test_few_bad_poses_are_left_out(tmp_path, messages, sound):
    def lost(odometry):
        pose = replace(odometry.pose.pose, position=POINT(math.nan, 0.0, 0.0))
        return replace(odometry, pose=replace(odometry.pose, pose=pose))

    log = open_log(bag(tmp_path / "few", changed(messages, "/odom", every(20, lost))))
    (note,) = [note for note in log.repairs if "messages of /odom are left out: message" in note]
    assert "expected a finite pose with a unit quaternion, got nan 0 0" in note
    assert_like(log.table, sound, atol=0.01)  # between the others
    with pytest.raises(LogError, match="got nan 0 0"):
        open_log(bag(tmp_path / "many", changed(messages, "/odom", every(5, lost))))


def test_a_pose_far_from_the_earth_is_left_out(tmp_path, messages, sound):
    def far(odometry):
        pose = replace(odometry.pose.pose, position=POINT(1e30, 0.0, 0.0))
        return replace(odometry, pose=replace(odometry.pose, pose=pose))

    log = open_log(bag(tmp_path / "bag", changed(messages, "/odom", every(50, far))))
    (note,) = [note for note in log.repairs if "messages of /odom are left out: message" in note]
    assert "got 1e+30 0 0" in note
    assert_like(log.table, sound, atol=0.01)  # between the others


@pytest.mark.parametrize("least", [-1.0, math.nan])
def test_a_range_min_that_is_none_is_zero(tmp_path, messages, sound, least):
    log = open_log(bag(tmp_path / "bag", changed(messages, "/scan", lambda scan, _: replace(scan, range_min=least))))
    assert_like(log.table, sound)
    assert set(log.table.range_limits[:, 0]) == {0.01}  # no lidar measures nearer
    assert f"range_min is {least:g}: taken as 0" in log.repairs


def test_a_range_max_that_is_none_can_be_given(tmp_path, messages, sound):
    path = bag(tmp_path / "bag", changed(messages, "/scan", lambda scan, _: replace(scan, range_max=math.nan)))
    with pytest.raises(LogError, match=r"range_min < range_max, got .* and nan"):
        open_log(path)
    assert_like(open_log(path, range_max=12.0).table, sound)


def test_scans_without_a_reading_are_refused(tmp_path, messages):
    """As of drivers that send intensities only."""
    bare = changed(messages, "/scan", lambda scan, _: replace(scan, ranges=np.zeros(0, np.float32)))
    with pytest.raises(LogError, match=r"all \d+ scans are empty: they have no ranges"):
        open_log(bag(tmp_path / "bag", bare))


def test_topics_can_be_chosen(tmp_path, messages, sound):
    def two(topic, names):
        return [
            (name, time, message)
            for there, time, message in messages
            for name in (names if there == topic else [there])
        ]

    path = bag(tmp_path / "odometry", two("/odom", ["/odom_raw", "/odom_combined"]))
    with pytest.raises(LogError, match="/odom_combined, /odom_raw; --topics NAME says which"):
        open_log(path)
    assert_like(open_log(path, topics=("/odom_raw",)).table, sound)
    path = bag(tmp_path / "scans", two("/scan", ["/left", "/right"]))
    with pytest.raises(LogError, match="/left, /right; --topics NAME says which"):
        open_log(path)
    assert_like(open_log(path, topics=("/right",)).table, sound)
    with pytest.raises(LogError, match="no topic /middle; there is: /left, /odom, /right"):
        open_log(path, topics=("/middle",))
