# SPDX-License-Identifier: MIT
"""ROS bags: what is written comes back, clocks and transforms are minded, damage is never a crash."""

import math
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from testbed.formats import LogError, open_log
from testbed.formats.head import LogHead, lidars_of
from testbed.formats.pose_interpolation import interpolate
from testbed.formats.ros.writing.types import DEFINITIONS, written_types
from testbed.formats.ros.writing.writer import write_bag as write_blocks_as_bag
from testbed.frame import Frame
from testbed.frame_table import FrameTable

STORE = get_typestore(Stores.ROS2_JAZZY)
MOUNT = (0.1, -0.02, 0.3)


def write_bag(path: Path, frames: list[Frame], truth_map=None, robot_urdf=None, **options) -> None:
    table = FrameTable.from_frames(frames)
    head = LogHead(lidars=lidars_of(table), truth_map=truth_map, robot_urdf=robot_urdf)
    write_blocks_as_bag(path, table.blocks(), head, **options)


def drive(frames: int = 12, beams: int = 7, seed: int = 0) -> list[Frame]:
    """Every third frame has a scan; numbers that float32 holds exactly."""
    rng = np.random.default_rng(seed)
    recording = []
    for k in range(frames):
        ranges = np.round(rng.uniform(0.5, 9.0, beams) * 64) / 64
        scan = Scan(
            ranges=np.where(rng.uniform(size=beams) < 0.2, math.inf, ranges),
            angles=-1.5 + 0.25 * np.arange(beams),
            range_min=0.125,
            range_max=8.5,
            stamp=k / 20,
            mount=MOUNT,
            time_offsets=2.0**-10 * np.arange(beams),
        )
        recording.append(
            Frame(
                stamp=k / 20,
                odometry=rng.uniform(-3, 3, 3),
                scan=scan if k % 3 == 0 else None,
                twist=rng.normal(size=3),
                truth=rng.uniform(-3, 3, 3),
            )
        )
    return recording


def assert_same_frames(read: list[Frame], written: list[Frame]) -> None:
    assert [frame.stamp for frame in read] == [frame.stamp for frame in written]
    for got, put in zip(read, written, strict=True):
        np.testing.assert_allclose(got.odometry, put.odometry, atol=1e-12)
        np.testing.assert_allclose(got.truth, put.truth, atol=1e-12)
        np.testing.assert_array_equal(got.twist, put.twist)
        assert (got.scan is None) == (put.scan is None)
        if put.scan is not None:
            np.testing.assert_array_equal(got.scan.ranges, put.scan.ranges)
            np.testing.assert_array_equal(got.scan.angles, put.scan.angles)
            np.testing.assert_array_equal(got.scan.time_offsets, put.scan.time_offsets)
            np.testing.assert_allclose(got.scan.mount, put.scan.mount, atol=1e-12)
            assert (got.scan.range_min, got.scan.range_max) == (put.scan.range_min, put.scan.range_max)


def test_round_trip_through_mcap(tmp_path):
    grid = OccupancyGrid(probability=np.eye(3, dtype=np.float32), resolution=0.05, origin=(1.0, 2.0, 0.0))
    write_bag(tmp_path / "bag", drive(), truth_map=grid)
    assert sorted(path.name for path in (tmp_path / "bag").iterdir()) == ["bag.mcap", "metadata.yaml"]
    assert_same_frames(open_log(tmp_path / "bag").frames, drive())
    assert_same_frames(open_log(tmp_path / "bag" / "bag.mcap").frames, drive())


def test_equal_frames_give_equal_bytes(tmp_path):
    (tmp_path / "b").mkdir()
    write_bag(tmp_path / "bag", drive())
    write_bag(tmp_path / "b" / "bag", drive())
    for name in ("bag.mcap", "metadata.yaml"):
        assert (tmp_path / "bag" / name).read_bytes() == (tmp_path / "b" / "bag" / name).read_bytes()


@pytest.mark.parametrize("storage", ["mcap", "sqlite", "rosbag1"])
@pytest.mark.parametrize("compressed", [False, True])
def test_messages_are_what_rosbags_would_write(tmp_path, storage, compressed):
    """The record layouts against the serialiser of the library, byte by byte."""
    path = tmp_path / ("bag.bag" if storage == "rosbag1" else "bag")
    known = [replace(frame, command=None if k % 5 else (0.25, -0.5)) for k, frame in enumerate(drive(600))]
    write_bag(path, known, storage=storage, compressed=compressed)
    store = STORE if storage != "rosbag1" else get_typestore(Stores.ROS1_NOETIC)
    with AnyReader([path], default_typestore=store) as reader:
        messages = list(reader.messages())
        counts = {c.topic: c.msgcount for c in reader.connections}
        for connection, time, raw in messages:
            message = reader.deserialize(raw, connection.msgtype)
            writer = reader.typestore.serialize_cdr if storage != "rosbag1" else reader.typestore.serialize_ros1
            assert bytes(writer(message, connection.msgtype)) == bytes(raw), connection.topic
            if hasattr(message, "header"):
                assert time == message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            if connection.topic == "/scan":
                assert message.scan_time == np.float32(0.15)  # every third frame of 20 a second
    assert (counts["/odom"], counts["/cmd_vel"], counts["/scan"]) == (600, 120, 200)
    assert [time for _, time, _ in messages] == sorted(time for _, time, _ in messages)


def test_types_are_those_of_ros():
    written, known = written_types(), get_typestore(Stores.ROS2_JAZZY)
    for name in DEFINITIONS:
        assert written.fielddefs[name] == known.fielddefs[name]
        assert written.generate_msgdef(name, ros_version=2) == known.generate_msgdef(name, ros_version=2)
        assert written.hash_rihs01(name) == known.hash_rihs01(name)


def test_the_mcap_library_reads_what_rosbags_reads(tmp_path):
    reader_of = pytest.importorskip("mcap.reader").make_reader
    write_bag(tmp_path / "bag", drive(600))
    with (tmp_path / "bag" / "bag.mcap").open("rb") as file:
        reader = reader_of(file, validate_crcs=True)
        found = [(channel.topic, message.log_time, message.data) for _, channel, message in reader.iter_messages()]
        assert reader.get_summary().statistics.message_count == len(found)
    with AnyReader([tmp_path / "bag"], default_typestore=STORE) as reader:
        expected = [(connection.topic, time, bytes(raw)) for connection, time, raw in reader.messages()]
    assert sorted(found) == sorted(expected)


URDF = """<robot name="two-link">
  <link name="base_link"/><link name="arm"/><link name="hand"/>
  <joint name="a" type="fixed"><parent link="base_link"/><child link="arm"/>
    <origin xyz="0.5 -1 2" rpy="0 1.5707963267948966 1.5707963267948966"/></joint>
  <joint name="b" type="fixed"><parent link="arm"/><child link="hand"/></joint>
</robot>"""


def messages_of(path: Path) -> dict[str, list]:
    """All messages by topic."""
    found: dict[str, list] = {}
    with AnyReader([path], default_typestore=STORE) as reader:
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    return found


def matrix(transform) -> np.ndarray:
    r, t = transform.rotation, transform.translation
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat([r.x, r.y, r.z, r.w]).as_matrix()
    T[:3, 3] = t.x, t.y, t.z
    return T


def test_the_point_cloud_lies_at_the_true_hits(tmp_path):
    write_bag(tmp_path / "bag", drive())
    found, frames = messages_of(tmp_path / "bag"), drive()
    mount = matrix(found["/tf_static"][0].transforms[0].transform)
    clouds = iter(found["/scan_cloud"])
    for frame, in_map, in_odom in zip(frames, found["/ground_truth/tf"], found["/tf"], strict=True):
        (on_map,), (on_odom,) = in_map.transforms, in_odom.transforms
        names = [(t.header.frame_id, t.child_frame_id) for t in (on_map, on_odom)]
        assert names == [("map", "odom"), ("odom", "base_link")]
        robot = matrix(on_map.transform) @ matrix(on_odom.transform)
        x, y, theta = frame.truth
        np.testing.assert_allclose(robot[:2, 3], (x, y), atol=1e-12)
        np.testing.assert_allclose(robot[:2, 0], (math.cos(theta), math.sin(theta)), atol=1e-12)
        if frame.scan is None:
            continue
        cloud = next(clouds)
        assert [(f.name, f.offset, f.datatype) for f in cloud.fields] == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
        points = cloud.data.view("<f4").reshape(cloud.width, 3)
        assert cloud.header.stamp.nanosec == round(1e9 * frame.stamp)
        ranges, angles = frame.scan.ranges[frame.scan.hit], frame.scan.angles[frame.scan.hit]
        ends = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
        hits = se2.transform_points(frame.truth, se2.transform_points(MOUNT, ends))
        placed = (robot @ mount @ np.column_stack([points, np.ones(len(points))]).T).T
        np.testing.assert_allclose(placed[:, :2], hits, atol=1e-5)
    assert next(clouds, None) is None


def test_a_bag_without_clouds_differs_in_nothing_else(tmp_path):
    write_bag(tmp_path / "whole", drive())
    write_bag(tmp_path / "lean", drive(), cloud=False)
    whole, lean = messages_of(tmp_path / "whole"), messages_of(tmp_path / "lean")
    assert set(whole) - set(lean) == {"/scan_cloud"}
    assert {topic: len(found) for topic, found in lean.items()}.items() <= {t: len(f) for t, f in whole.items()}.items()
    assert_same_frames(open_log(tmp_path / "lean").frames, drive())


def test_one_static_message_holds_all_joints(tmp_path):
    write_bag(tmp_path / "bag", drive(), robot_urdf=URDF)
    found = messages_of(tmp_path / "bag")
    assert [text.data for text in found["/robot_description"]] == [URDF]
    (static,) = found["/tf_static"]  # late subscribers receive the last one only
    names = [(t.header.frame_id, t.child_frame_id) for t in static.transforms]
    assert names == [("base_link", "laser"), ("base_link", "arm"), ("arm", "hand")]
    _, arm, hand = (matrix(t.transform) for t in static.transforms)
    # first pitched by 90 degrees, x down and z ahead; then turned to the left, z to the left
    np.testing.assert_allclose(arm, [[0, -1, 0, 0.5], [0, 0, 1, -1], [-1, 0, 0, 2], [0, 0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(hand, np.eye(4), atol=1e-15)
    with AnyReader([tmp_path / "bag"], default_typestore=STORE) as reader:
        durability = {c.topic: [q.durability.name for q in c.ext.offered_qos_profiles] for c in reader.connections}
    assert {t for t, kept in durability.items() if kept == ["TRANSIENT_LOCAL"]} == {"/tf_static", "/robot_description"}
    assert_same_frames(open_log(tmp_path / "bag").frames, drive())


def test_rotations_are_about_the_fixed_axes(tmp_path):
    turns = np.random.default_rng(0).uniform(-math.pi, math.pi, (50, 3))
    joints = [
        f'<joint name="{k}" type="fixed"><parent link="base_link"/><child link="{k}"/>'
        f'<origin rpy="{" ".join(map(repr, rpy))}"/></joint>'
        for k, rpy in enumerate(turns.tolist())
    ]
    write_bag(tmp_path / "bag", drive(), robot_urdf=f"<robot>{''.join(joints)}</robot>")
    (static,) = messages_of(tmp_path / "bag")["/tf_static"]
    found = [matrix(stamped.transform)[:3, :3] for stamped in static.transforms[1:]]
    np.testing.assert_allclose(found, Rotation.from_euler("xyz", turns).as_matrix(), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda f: f[::-1], "frame 1: the stamps step backwards"),
        (lambda f: [], "no frames"),
        (lambda f: [replace(frame, stamp=frame.stamp - 1.0) for frame in f], "expected 0 to"),
        (lambda f: [replace(f[0], scan=replace(f[0].scan, mount=(0.0, 0.0, 0.0))), *f[1:]], "different places"),
        (lambda f: [replace(f[0], scan=replace(f[0].scan, angles=f[0].scan.angles ** 3)), *f[1:]], "evenly spaced"),
    ],
)
def test_data_a_bag_cannot_hold_is_refused(tmp_path, change, complaint):
    with pytest.raises(LogError, match=complaint):
        write_bag(tmp_path / "bag", change(drive()))
    assert list(tmp_path.iterdir()) == []


# --- bags of other programs -------------------------------------------------------------------------------------------


def message(kind: str, **values):
    return STORE.types[kind](**values)


def header(stamp: float, frame: str):
    seconds = math.floor(stamp)
    time = message("builtin_interfaces/msg/Time", sec=seconds, nanosec=round((stamp - seconds) * 1e9))
    return message("std_msgs/msg/Header", stamp=time, frame_id=frame)


def quaternion(x=0.0, y=0.0, z=0.0, w=1.0):
    return message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def odometry(stamp: float, x: float, rotation=None):
    g = "geometry_msgs/msg/"
    zero = message(g + "Vector3", x=0.0, y=0.0, z=0.0)
    pose = message(g + "Pose", position=message(g + "Point", x=x, y=0.0, z=0.0), orientation=rotation or quaternion())
    twist = message(g + "Twist", linear=zero, angular=zero)
    return message(
        "nav_msgs/msg/Odometry",
        header=header(stamp, "odom"),
        child_frame_id="base_footprint",
        pose=message(g + "PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
        twist=message(g + "TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


def scan(stamp: float, **changes):
    values = {
        "angle_min": -0.5, "angle_max": 0.5, "angle_increment": 0.5, "time_increment": 0.0, "scan_time": 0.1,
        "range_min": 0.1, "range_max": 10.0, "ranges": np.ones(3, dtype=np.float32),
        "intensities": np.empty(0, dtype=np.float32),
    }  # fmt: skip
    return message("sensor_msgs/msg/LaserScan", header=header(stamp, "lidar"), **(values | changes))


def static(parent: str, child: str, x: float, rotation=None):
    g = "geometry_msgs/msg/"
    transform = message(
        g + "Transform", translation=message(g + "Vector3", x=x, y=0.0, z=0.2), rotation=rotation or quaternion()
    )
    stamped = message(g + "TransformStamped", header=header(0.0, parent), child_frame_id=child, transform=transform)
    return message("tf2_msgs/msg/TFMessage", transforms=[stamped])


def bag_of(path: Path, messages: list, plugin=StoragePlugin.SQLITE3) -> Path:
    """A rosbag2 directory of (topic, seconds, message)."""
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for topic, stamp, content in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, content.__msgtype__, typestore=STORE)
            raw = STORE.serialize_cdr(content, content.__msgtype__)
            writer.write(connections[topic], round(stamp * 1e9), raw)
    return path


def plain(*extra) -> list:
    """Odometry at 0, 1, 2 s along x, a scan at 0.5 and 1.5 s."""
    messages = [("/odom", t, odometry(t, t)) for t in (0.0, 1.0, 2.0)]
    return [*extra, *messages, ("/scan", 0.5, scan(0.5)), ("/scan", 1.5, scan(1.5))]


def test_odometry_is_interpolated_at_the_scans(tmp_path):
    frames = open_log(bag_of(tmp_path / "bag", plain())).frames
    assert [(frame.stamp, frame.odometry[0], frame.scan is not None) for frame in frames] == [
        (0.0, 0.0, False), (0.5, 0.5, True), (1.0, 1.0, False), (1.5, 1.5, True), (2.0, 2.0, False),
    ]  # fmt: skip


@given(share=st.floats(0.0, 1.0), seed=st.integers(0, 2**32 - 1))
def test_interpolation_meets_its_ends_and_turns_the_short_way(share, seed):
    a, b = np.random.default_rng(seed).uniform(-np.pi, np.pi, (2, 3))
    (at,) = interpolate(np.array([1.0, 2.0]), np.array([a, b]), np.array([1.0 + share]))
    whole, part = se2.between(a, b), se2.between(a, at)
    np.testing.assert_allclose(part[2], share * whole[2], atol=1e-9)
    np.testing.assert_allclose(np.hypot(*part[:2]), share * np.hypot(*whole[:2]), atol=1e-9)


def test_the_mount_is_the_chain_of_static_transforms(tmp_path):
    chain = [
        ("/tf_static", 0.0, static("base_footprint", "base_link", 0.1)),
        ("/tf_static", 0.0, static("base_link", "lidar", 0.2, quaternion(z=math.sin(0.5), w=math.cos(0.5)))),
    ]
    read = open_log(bag_of(tmp_path / "bag", plain(*chain))).frames[1].scan
    np.testing.assert_allclose(read.mount, [0.3, 0.0, 1.0], atol=1e-12)


def test_a_lidar_upside_down_turns_the_other_way(tmp_path):
    hanging = ("/tf_static", 0.0, static("base_footprint", "lidar", 0.0, quaternion(x=1.0, w=0.0)))
    read = open_log(bag_of(tmp_path / "bag", plain(hanging))).frames[1].scan
    np.testing.assert_allclose(read.angles, [0.5, 0.0, -0.5])


def test_topics_of_one_lidar_count_once(tmp_path):
    def seen(stamp: float, frame: str):
        return replace(scan(stamp), header=header(stamp, frame))

    mounts = [("/tf_static", 0.0, static("base_footprint", name, x)) for name, x in (("lidar", 0.2), ("back", -0.3))]
    others = [("/scan_filtered", 0.5, scan(0.5)), ("/rear/scan", 0.7, seen(0.7, "back"))]
    log = open_log(bag_of(tmp_path / "bag", plain(*mounts, *others)))
    scans = [(frame.stamp, frame.lidar, frame.scan.mount[0]) for frame in log.frames if frame.scan is not None]
    assert scans == [(0.5, "lidar", 0.2), (0.7, "back", pytest.approx(-0.3)), (1.5, "lidar", 0.2)]
    assert log.notes == (
        "scans from /rear/scan and /scan, odometry from /odom",
        "topics left out: /scan_filtered (the same lidar)",
    )


@pytest.mark.parametrize("stamped", [False, True])
def test_commands_are_those_in_force(tmp_path, stamped):
    g, zero = "geometry_msgs/msg/", {"x": 0.0, "y": 0.0, "z": 0.0}

    def command(speed: float, stamp: float):
        linear, angular = (message(g + "Vector3", **zero | {"x": x}) for x in (speed, 0.0))
        twist = message(g + "Twist", linear=linear, angular=angular)
        return message(g + "TwistStamped", header=header(stamp, "base"), twist=twist) if stamped else twist

    commands = [("/cmd_vel", t, command(speed, t)) for t, speed in ((0.4, 0.1), (1.2, 0.3))]
    frames = open_log(bag_of(tmp_path / "bag", plain(*commands))).frames
    assert [frame.command for frame in frames] == [None, (0.1, 0.0), (0.1, 0.0), (0.3, 0.0), (0.3, 0.0)]


def test_ros1_bags_are_read(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(tmp_path / "old.bag") as writer:
        connections = {}
        for topic, stamp, content in plain():
            kind = content.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            ros1 = to_ros1(store, content, stamp)
            writer.write(connections[topic], round(stamp * 1e9), store.serialize_ros1(ros1, kind))
    frames = open_log(tmp_path / "old.bag").frames
    assert [frame.odometry[0] for frame in frames if frame.scan is not None] == [0.5, 1.5]


def to_ros1(store, content, stamp):
    """The same message with the header of ROS 1, which counts messages."""
    fields = {name: getattr(content, name) for name in content.__dataclass_fields__ if name != "__msgtype__"}
    old = store.types["std_msgs/msg/Header"]
    fields["header"] = old(seq=0, stamp=content.header.stamp, frame_id=content.header.frame_id)
    return store.types[content.__msgtype__](**fields)


@pytest.mark.parametrize(
    ("messages", "complaint"),
    [
        ([("/odom", 0.0, odometry(0.0, 0.0))], "no scans in this ROS bag; scans from nowhere, odometry from /odom"),
        ([("/scan", 0.0, scan(0.0))], "no topic of type nav_msgs/msg/Odometry"),
        ([*plain(), ("/a", 1.0, odometry(1.0, 1.0)), ("/front", 1.0, scan(1.0))], None),
        ([("/a", 0.0, scan(0.0)), ("/b", 0.0, scan(0.0)), *plain()[:3]], "scans of one lidar, none is /scan: /a, /b"),
        ([*plain()[:3], ("/scan", 1e6, scan(1e6))], "the clocks of scans and odometry do not meet"),
        ([*plain(), ("/odom", 3.0, odometry(3.0, math.nan))], r"message 6 \(/odom\): expected a finite pose"),
        ([*plain(), ("/odom", 3.0, odometry(3.0, 0.0, quaternion(w=0.0)))], "unit quaternion"),
        ([*plain(), ("/odom", 3.0, odometry(3.0, 0.0, quaternion(x=0.6, w=0.8)))], "the robot leans by 74 degrees"),
        ([*plain()[:3], ("/scan", 1.0, scan(1.0, angle_increment=math.nan))], "angles must be finite"),
        ([*plain()[:3], ("/scan", 1.0, scan(1.0, range_max=0.0))], "expected 0 <= range_min < range_max"),
        (plain(("/tf_static", 0.0, static("map", "other", 0.0))), "no transforms lead from"),
    ],
)
def test_nonsense_in_a_bag_is_refused_with_its_place(tmp_path, messages, complaint):
    path = bag_of(tmp_path / "bag", messages)
    if complaint is None:
        assert open_log(path).scan_count == 2
        return
    with pytest.raises(LogError, match=complaint) as error:
        open_log(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_topics_of_unknown_types_are_counted_and_left_out(tmp_path):
    known = get_typestore(Stores.ROS2_JAZZY)
    known.register(get_types_from_msg("float64 level", "our_msgs/msg/Battery"))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, content in [("/odom", odometry(0.0, 0.0)), ("/scan", scan(0.0))]:
            connection = writer.add_connection(topic, content.__msgtype__, typestore=STORE)
            writer.write(connection, 0, STORE.serialize_cdr(content, content.__msgtype__))
        battery = writer.add_connection("/battery", "our_msgs/msg/Battery", typestore=known)
        raw = known.serialize_cdr(known.types["our_msgs/msg/Battery"](level=0.5), "our_msgs/msg/Battery")
        writer.write(battery, 0, raw)
    assert "topics left out: /battery (our_msgs/msg/Battery, 1 messages)" in open_log(tmp_path / "bag").notes


def test_scans_outside_of_the_odometry_are_counted(tmp_path):
    log = open_log(bag_of(tmp_path / "bag", [*plain(), ("/scan", 9.0, scan(9.0))]))
    assert log.scan_count == 2
    assert any("1 of 3 scans lie outside" in note for note in log.notes)


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sound")
    write_bag(folder / "mcap", drive())
    bag_of(folder / "sqlite", plain())
    return folder


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_a_cut_or_changed_byte_never_crashes(tmp_path_factory, sound, data):
    folder = tmp_path_factory.mktemp("damaged") / "bag"
    shutil.copytree(sound / data.draw(st.sampled_from(["mcap", "sqlite"])), folder)
    path = data.draw(st.sampled_from(sorted(folder.iterdir())))
    whole = path.read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    cut = data.draw(st.booleans())
    path.write_bytes(
        whole[:at] if cut else whole[:at] + bytes([whole[at] ^ data.draw(st.integers(1, 255))]) + whole[at + 1 :]
    )
    try:
        log = open_log(folder)
    except LogError as error:
        complaint = str(error)
    else:
        complaint = f"{folder}"
        assert all(np.all(np.isfinite(frame.odometry)) for frame in log.frames)
    assert str(folder) in complaint
    assert "\n" not in complaint


@pytest.mark.skipif(os.name != "posix", reason="links")
def test_metadata_paths_cannot_leave_the_directory(tmp_path, sound):
    folder = tmp_path / "bag"
    folder.mkdir()
    text = (sound / "mcap" / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("mcap.mcap", f"{sound}/mcap/mcap.mcap"))
    with pytest.raises(LogError, match="missing"):
        open_log(folder)


def test_a_huge_metadata_file_is_refused(tmp_path, sound):
    folder = tmp_path / "bag"
    shutil.copytree(sound / "mcap", folder)
    with (folder / "metadata.yaml").open("a") as file:
        file.write("#" * 2_000_000)
    with pytest.raises(LogError, match="larger than"):
        open_log(folder)
