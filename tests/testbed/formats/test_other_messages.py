# SPDX-License-Identifier: MIT
"""Bags whose scans, truth or chunks are of another kind than those that are written here: the same is read."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from testbed.datasets.simulated import write_dataset
from testbed.formats import LogError, open_log
from testbed.simulation import SimulationConfig
from tests.testbed.formats.bags import STORE, bag, set_back
from worlds import load

T = STORE.types
FRAMES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""The type of transforms, and that of ROS 1 before 2013."""
TOPICS = ("/scan", "/odom", "/tf", "/tf_static", "/ground_truth/odom")


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("source") / "drive"
    config = SimulationConfig(backend="fast", duration=4.0)
    write_dataset(path, load("office"), config, {"seed": 0}, log_format="rosbag2-lean")
    return path


@pytest.fixture(scope="module")
def messages(source):
    with AnyReader([source], default_typestore=STORE) as reader:
        found = [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]
    return [message for message in found if message[0] in TOPICS]


@pytest.fixture(scope="module")
def sound(tmp_path_factory, messages):
    return open_log(bag(tmp_path_factory.mktemp("sound") / "bag", messages)).table


def with_echoes(scan, echoes):
    """A scan as one of a lidar with several echoes; `echoes` makes those of a reading."""
    names = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
    echo = T["sensor_msgs/msg/LaserEcho"]
    return T["sensor_msgs/msg/MultiEchoLaserScan"](
        header=scan.header,
        ranges=[echo(np.array(echoes(value), dtype=np.float32)) for value in scan.ranges.tolist()],
        intensities=[],
        **{name: getattr(scan, name) for name in names},
    )


def test_of_several_echoes_the_first_counts(tmp_path, messages, sound):
    def change(name, message):
        return with_echoes(message, lambda value: [value, value + 1.0]) if name == "/scan" else message

    log = open_log(bag(tmp_path / "bag", [(name, time, change(name, m)) for name, time, m in messages]))
    np.testing.assert_array_equal(log.table.ranges, sound.ranges)
    np.testing.assert_array_equal(log.table.patterns[0].angles, sound.patterns[0].angles)


def test_an_echo_that_is_no_number_is_none(tmp_path, messages, sound):
    def change(name, message):
        return with_echoes(message, lambda value: [np.nan, value]) if name == "/scan" else message

    log = open_log(bag(tmp_path / "bag", [(name, time, change(name, m)) for name, time, m in messages]))
    np.testing.assert_array_equal(log.table.ranges, sound.ranges)


def test_a_direction_without_an_echo_is_unknown(tmp_path, messages, sound):
    def change(name, message):
        return with_echoes(message, lambda value: [value] if value < 3.0 else []) if name == "/scan" else message

    log = open_log(bag(tmp_path / "bag", [(name, time, change(name, m)) for name, time, m in messages]))
    near = sound.ranges < 3.0
    np.testing.assert_array_equal(log.table.ranges[near], sound.ranges[near])
    assert np.isnan(log.table.ranges[~near]).all()


def stamped(message):
    return T["geometry_msgs/msg/PoseStamped"](message.header, message.pose.pose)


def covariant(message):
    return T["geometry_msgs/msg/PoseWithCovarianceStamped"](message.header, message.pose)


def transformed(message):
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    place = T["geometry_msgs/msg/Vector3"](position.x, position.y, position.z)
    transform = T["geometry_msgs/msg/Transform"](place, turn)
    return T["geometry_msgs/msg/TransformStamped"](message.header, "base_link", transform)


def growing(messages):
    """A Path that is sent again with each pose."""
    path, poses = T["nav_msgs/msg/Path"], []
    for _, time, message in messages:
        poses.append(stamped(message))
        yield "/truth/path", time, path(message.header, list(poses))


@pytest.mark.parametrize(
    "kind", [stamped, covariant, transformed, "path"], ids=["stamped", "covariant", "transformed", "path"]
)
@pytest.mark.parametrize("topic", ["/vrpn_client_node/robot/pose", "/mocap/pose"])
def test_truth_of_other_kinds(tmp_path, messages, sound, kind, topic):
    truths = [message for message in messages if message[0] == "/ground_truth/odom"]
    others = [message for message in messages if message[0] != "/ground_truth/odom"]
    new = list(growing(truths)) if kind == "path" else [(topic, time, kind(m)) for _, time, m in truths]
    log = open_log(bag(tmp_path / "bag", [*others, *new]))
    np.testing.assert_allclose(log.table.truth, sound.truth, atol=1e-9, equal_nan=True)
    assert np.isfinite(log.table.truth).any()


def as_mocap(messages, change):
    """The messages with their truth as stamped poses; `change` gets each with its number, and leaves out with None."""
    truths = [(time, stamped(m)) for name, time, m in messages if name == "/ground_truth/odom"]
    poses = [(time, change(pose, k)) for k, (time, pose) in enumerate(truths)]
    others = [message for message in messages if message[0] != "/ground_truth/odom"]
    return [*others, *(("/mocap/pose", time, pose) for time, pose in poses if pose is not None)]


def test_in_a_gap_of_the_truth_it_is_unknown(tmp_path, messages, sound):
    log = open_log(bag(tmp_path / "bag", as_mocap(messages, lambda pose, k: None if 25 <= k < 45 else pose)))
    known = np.isfinite(log.table.truth).all(axis=1)
    assert 0.2 < np.mean(np.isfinite(sound.truth).all(axis=1) & ~known) < 0.3
    np.testing.assert_allclose(log.table.truth[known], sound.truth[known], atol=1e-9)
    assert any("the truth is unknown in 1 of its gaps, of up to 1." in note for note in log.notes)


@pytest.mark.parametrize(("every", "is_used"), [(5, True), (1, False)])
def test_true_poses_that_are_none_are_left_out_where_they_are_few(tmp_path, messages, sound, every, is_used):
    def lose(pose, k):
        place = T["geometry_msgs/msg/Point"](np.nan, np.nan, np.nan)
        return replace(pose, pose=replace(pose.pose, position=place)) if k % every == 0 else pose

    log = open_log(bag(tmp_path / "bag", as_mocap(messages, lose)))
    known = np.isfinite(log.table.truth).all(axis=1)
    assert known.any() == is_used
    np.testing.assert_allclose(log.table.truth[known], sound.truth[known], atol=0.01)
    words = "poses of /mocap/pose are left out: pose 1: " if is_used else "/mocap/pose is not used as truth: pose 1: "
    assert any(words in note for note in log.notes)


def test_odometry_as_truth_comes_first(tmp_path, messages, sound):
    far = [("/mocap/pose", time, stamped(m)) for name, time, m in messages if name == "/odom"]
    log = open_log(bag(tmp_path / "bag", [*messages, *far]))
    np.testing.assert_array_equal(log.table.truth, sound.truth)
    assert any("/mocap/pose" in note for note in log.notes)


def test_truth_of_a_clock_that_is_set_back(tmp_path, messages, sound):
    half = messages[len(messages) // 2][1]
    back = [(topic, t, set_back(m, 0.5) if t > half else m) for topic, t, m in messages]
    table = open_log(bag(tmp_path / "bag", back)).table
    np.testing.assert_allclose(table.truth, sound.truth, atol=1e-6)


def test_poses_of_a_camera_are_no_truth(tmp_path, messages):
    s = math.sqrt(0.5)
    turn = T["geometry_msgs/msg/Quaternion"](s, 0.0, 0.0, s)
    pose = [
        ("/mocap/pose", time, replace(stamped(m), pose=replace(m.pose.pose, orientation=turn)))
        for name, time, m in messages
        if name == "/odom"
    ]
    log = open_log(bag(tmp_path / "bag", [*(m for m in messages if m[0] != "/ground_truth/odom"), *pose]))
    assert np.isnan(log.table.truth).all()
    assert "/mocap/pose is not used as truth: pose 1: the robot leans by 90 degrees" in log.notes


def test_a_path_without_times_is_no_truth(tmp_path, messages):
    zero = T["builtin_interfaces/msg/Time"](0, 0)
    poses = [stamped(m) for name, _, m in messages if name == "/odom"]
    poses = [replace(pose, header=replace(pose.header, stamp=zero)) for pose in poses]
    path = ("/truth", messages[-1][1], T["nav_msgs/msg/Path"](poses[0].header, poses))
    log = open_log(bag(tmp_path / "bag", [*(m for m in messages if m[0] != "/ground_truth/odom"), path]))
    assert np.isnan(log.table.truth).all()
    assert any("all poses have the stamp 0 s" in note for note in log.notes)


@pytest.mark.parametrize("compression", [None, Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
@pytest.mark.parametrize(("has_index", "frames"), [(True, FRAMES[0]), (False, FRAMES[0]), (True, FRAMES[1])])
def test_bags_of_ros_1_with_packed_chunks(tmp_path, messages, sound, compression, has_index, frames):
    store = get_typestore(Stores.ROS1_NOETIC)
    transforms = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(transforms, frames))
    path = tmp_path / "drive.bag"
    writer = Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connections = {}
        for topic, time, message in messages:
            kind = frames if hasattr(message, "transforms") else message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], time, store.serialize_ros1(_with_counters(store, message), kind))
    if not has_index:
        content = bytearray(path.read_bytes())
        at = content.index(b"index_pos=") + 10
        content[at : at + 8] = bytes(8)
        path.write_bytes(content)
    table = open_log(path).table
    np.testing.assert_array_equal(table.ranges, sound.ranges)
    np.testing.assert_allclose(table.odometry, sound.odometry, atol=1e-9)
    np.testing.assert_allclose(table.mounts, sound.mounts, atol=1e-9)


def _with_counters(store, message):
    """The message with the headers of ROS 1."""
    if hasattr(message, "transforms"):
        return replace(message, transforms=[_with_counters(store, part) for part in message.transforms])
    header = store.types["std_msgs/msg/Header"](seq=0, stamp=message.header.stamp, frame_id=message.header.frame_id)
    return replace(message, header=header)


def leaning(messages, name="laser"):
    """The static transforms with one more lidar, which looks down, and its scans."""
    s = math.sqrt(0.5)
    for topic, time, message in messages:
        if topic == "/tf_static":
            down = next(part for part in message.transforms if part.child_frame_id == name)
            down = replace(down, child_frame_id="down", transform=replace(
                down.transform, rotation=T["geometry_msgs/msg/Quaternion"](s, 0.0, 0.0, s)
            ))  # fmt: skip
            yield topic, time, replace(message, transforms=[*message.transforms, down])
            continue
        yield topic, time, message
        if topic == "/scan":
            yield "/scan_down", time, replace(message, header=replace(message.header, frame_id="down"))


def test_a_lidar_that_leans_is_left_out_if_another_does_not(tmp_path, messages, sound):
    log = open_log(bag(tmp_path / "both", list(leaning(messages))))
    np.testing.assert_array_equal(log.table.ranges, sound.ranges)
    assert log.table.lidars == sound.lidars
    assert any("scans of down are left out: the lidar (down) leans by 90 degrees" in note for note in log.repairs)
    with pytest.raises(LogError, match="leans by 90 degrees"):
        open_log(bag(tmp_path / "down", [m for m in leaning(messages) if m[0] != "/scan"]))
