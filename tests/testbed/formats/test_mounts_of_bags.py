# SPDX-License-Identifier: MIT
"""Mounts in /tf that are not quite fixed, and transforms under other names."""

from dataclasses import replace

import numpy as np
import pytest

from testbed.formats import LogError, open_log
from testbed.formats.ros.reading.transforms import LeaningLidarError, NotConnectedError, Transforms
from tests.testbed.formats.bags import assert_like, bag, changed


def with_mounts_in_tf(messages: list, shift) -> list:
    """The bag with its static transforms in /tf; `shift` says how far the numbered one is off [m]."""
    (static,) = [message for topic, _, message in messages if topic == "/tf_static"]

    def added(message, number):
        stamp = message.transforms[0].header.stamp
        again = []
        for mount in static.transforms:
            place = mount.transform.translation
            moved = replace(mount.transform, translation=replace(place, x=place.x + shift(number)))
            again.append(replace(mount, header=replace(mount.header, stamp=stamp), transform=moved))
        return replace(message, transforms=[*message.transforms, *again])

    return changed([m for m in messages if m[0] != "/tf_static"], "/tf", added)


def test_the_middle_of_a_mount_that_shakes_is_taken(tmp_path, messages, sound):
    log = open_log(bag(tmp_path / "bag", with_mounts_in_tf(messages, lambda k: 0.01 * (k % 3 - 1))))
    assert_like(log.table, sound)
    assert "the transform of laser changes by up to 0.010 m or rad: the middle one is taken" in log.repairs


def test_a_lidar_that_is_moved_about_is_refused(tmp_path, messages, sound):
    path = bag(tmp_path / "bag", with_mounts_in_tf(messages, lambda k: 0.3 * np.sin(0.1 * k)))
    with pytest.raises(
        LogError, match="laser moves on base_link: only lidars on fixed mounts are read; --laser-offset"
    ):
        open_log(path)
    assert open_log(path, laser_offset=0.1).scan_count == len(sound.scan_rows)


def test_a_static_transform_that_is_sent_again_with_other_numbers_is_noted(tmp_path, messages, sound):
    (static,) = [message for topic, _, message in messages if topic == "/tf_static"]
    again = [("/tf_static", messages[-1][1], static)]
    assert not open_log(bag(tmp_path / "equal", messages + again)).repairs
    wrong = replace(static, transforms=[_turned(mount) for mount in static.transforms])
    log = open_log(bag(tmp_path / "other", [("/tf_static", 0, wrong), *messages]))
    assert_like(log.table, sound)
    assert "the transform of laser is sent again with other numbers: the last one counts" in log.repairs


def test_so_is_one_below_the_lidar_whose_frame_is_the_root_of_the_tree(tmp_path, messages):
    (static,) = [message for topic, _, message in messages if topic == "/tf_static"]
    upside = [
        replace(mount, header=replace(mount.header, frame_id="laser"), child_frame_id="base_link")
        for mount in static.transforms
    ]
    others = [m for m in messages if m[0] != "/tf_static"]
    once = replace(static, transforms=upside[:1])
    assert not open_log(bag(tmp_path / "once", [("/tf_static", 0, once), *others])).repairs
    twice = [replace(upside[0], transform=_turned(upside[0]).transform), upside[0]]
    log = open_log(bag(tmp_path / "twice", [("/tf_static", 0, replace(static, transforms=twice)), *others]))
    assert "the transform of base_link is sent again with other numbers: the last one counts" in log.repairs


def _turned(mount):
    turn = replace(mount.transform.rotation, x=0.0, y=0.0, z=1.0, w=0.0)
    return replace(mount, transform=replace(mount.transform, rotation=turn))


def test_transforms_of_a_robot_with_a_name(tmp_path, messages, sound):
    """Topics below /robot1, as of one of many robots."""
    named = [(f"/robot1{topic}", t, m) for topic, t, m in messages if topic != "/odom"]
    log = open_log(bag(tmp_path / "bag", named))
    assert_like(log.table, sound)
    assert "odometry from /robot1/tf (odom to base_link)" in log.notes[0]


@pytest.mark.parametrize("above", [True, False])
def test_a_footprint_above_or_below_the_base(tmp_path, messages, sound, above):
    """Odometry of one of the robot's two frames, which a static transform joins to the other."""
    (static,) = [message for topic, _, message in messages if topic == "/tf_static"]
    frames = ("base_footprint", "base_link") if above else ("base_link", "base_footprint")
    joint = replace(
        static.transforms[0],
        header=replace(static.transforms[0].header, frame_id=frames[0]),
        child_frame_id=frames[1],
        transform=_at_height(static.transforms[0].transform, 0.1),
    )
    joined = replace(static, transforms=[*static.transforms, joint])

    def of_first(message, _):
        return replace(message, transforms=[replace(t, child_frame_id=frames[0]) for t in message.transforms])

    kept = changed([m for m in messages if m[0] != "/odom"], "/tf", of_first)
    log = open_log(bag(tmp_path / "bag", changed(kept, "/tf_static", lambda _, __: joined)))
    assert_like(log.table, sound)
    assert f"odometry from /tf (odom to {frames[0]})" in log.notes[0]


def _at_height(transform, z: float):
    place = replace(transform.translation, x=0.0, y=0.0, z=z)
    return replace(transform, translation=place, rotation=replace(transform.rotation, x=0.0, y=0.0, z=0.0, w=1.0))


def test_a_bag_without_odometry_says_which_transforms_there_are(tmp_path, messages):
    def by_slam(message, _):
        return replace(
            message, transforms=[replace(t, header=replace(t.header, frame_id="map")) for t in message.transforms]
        )

    path = bag(tmp_path / "bag", changed([m for m in messages if m[0] != "/odom"], "/tf", by_slam))
    with pytest.raises(LogError, match="/tf has no transform from odom, but map to base_link"):
        open_log(path)


def test_what_is_wrong_with_a_mount_is_told_by_its_kind_not_by_its_words():
    """A frame may have any name."""
    upright = np.eye(4)
    on_its_side = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    tree = Transforms({"laser": ("base", upright), "down": ("base", on_its_side)})
    assert tree.leads("base", "laser")
    with pytest.raises(LeaningLidarError, match="leans by 90 degrees"):
        tree.mount("base", "down")
    with pytest.raises(NotConnectedError, match="no transforms lead from leans to base"):
        tree.mount("base", "leans")
    assert not tree.leads("base", "leans")
