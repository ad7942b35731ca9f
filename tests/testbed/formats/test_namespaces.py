# SPDX-License-Identifier: MIT
"""Bags of several robots: one is read where it is named, and the choices are named where none is."""

from dataclasses import replace

import pytest

from testbed.formats import LogError, open_log
from tests.testbed.formats.bags import assert_like, bag, set_back

ROBOTS = ("r1", "r2")


def of_robot(messages: list, name: str, *, own_tf: bool = False) -> list:
    """The messages with topics and frames of a robot; transforms in the common /tf unless it has its own."""
    found = []
    for topic, time, message in messages:
        named = topic if topic.startswith("/tf") and not own_tf else f"/{name}{topic}"
        found.append((named, time, in_namespace(message, name)))
    return found


def in_namespace(message, name: str):
    """The message with frames of a robot."""
    if hasattr(message, "transforms"):
        return replace(message, transforms=[in_namespace(transform, name) for transform in message.transforms])
    message = replace(message, header=replace(message.header, frame_id=f"{name}/{message.header.frame_id}"))
    if hasattr(message, "child_frame_id"):
        message = replace(message, child_frame_id=f"{name}/{message.child_frame_id}")
    return message


def two(messages: list, **how) -> list:
    """Both robots, of which the second was half a second earlier at each place."""
    early = [(topic, time, set_back(message, 0.5)) for topic, time, message in messages]
    found = of_robot(messages, "r1", **how) + of_robot(early, "r2", **how)
    return sorted(found, key=lambda message: message[1])


@pytest.mark.parametrize("own_tf", [False, True])
@pytest.mark.parametrize("without", [(), ("/odom",)], ids=["", "odometry in tf"])
def test_the_robot_that_is_named_is_read(tmp_path, messages, sound, own_tf, without):
    path = bag(tmp_path / "bag", two([m for m in messages if m[0] not in without], own_tf=own_tf))
    for name, offset in zip(ROBOTS, (0.0, -0.5), strict=True):
        table = open_log(path, namespace=name).table
        assert table.lidars == (f"{name}/laser",)
        assert_like(replace(table, stamps=table.stamps - offset), sound)
    with pytest.raises(LogError, match="--namespace NAME reads one robot of r1, r2") as raised:
        open_log(path)
    assert "\n" not in str(raised.value)


def test_scans_and_odometry_of_different_robots_are_named(tmp_path, messages):
    left_out = ("/r1/odom", "/r2/scan")
    path = bag(tmp_path / "bag", [m for m in two(messages) if m[0] not in left_out])
    with pytest.raises(LogError, match="r1/laser to r2/base_link; --namespace NAME reads one robot of r1, r2"):
        open_log(path)


def test_a_robot_that_is_not_there_is_refused(tmp_path, messages):
    path = bag(tmp_path / "bag", two(messages))
    with pytest.raises(LogError, match="no topic begins with /r3/; --namespace NAME reads one robot of r1, r2"):
        open_log(path, namespace="r3")
    with pytest.raises(LogError, match="no topic begins with /r1/; leave --namespace out"):
        open_log(bag(tmp_path / "one", messages), namespace="r1")
