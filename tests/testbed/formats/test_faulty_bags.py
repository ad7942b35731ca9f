# SPDX-License-Identifier: MIT
"""Bags as people bring them: each fault is mended with a note and the right values, or refused with the numbers."""

import shutil
import sqlite3
from dataclasses import replace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

from slam import se2
from testbed.datasets.simulated import write_dataset
from testbed.formats import Log, LogError, open_log
from testbed.formats.write import write_log
from testbed.simulation import SimulationConfig
from tests.testbed.formats.bags import STORE, TIME, assert_like, at_zero, bag, changed, set_back
from tests.testbed.formats.conftest import TOPICS
from worlds import load


def test_odometry_in_tf_only(tmp_path, messages, sound):
    log = open_log(bag(tmp_path / "bag", [m for m in messages if m[0] != "/odom"]))
    assert_like(log.table, sound)
    assert "odometry from /tf (odom to base_link)" in log.notes[0]
    rows = log.table.scan_rows
    speed = np.abs(log.table.twist[rows] - sound.twist[sound.scan_rows])
    assert np.median(speed, axis=0).max() < 0.05  # over the next 50 ms instead of the scan's time


def test_transforms_of_the_robot_from_elsewhere_are_noted(tmp_path, messages, sound):
    def lost(message, number):
        (transform,) = message.transforms
        parent = "map" if number in (40, 41) else transform.header.frame_id
        return replace(message, transforms=[replace(transform, header=replace(transform.header, frame_id=parent))])

    kept = [m for m in messages if m[0] != "/odom"]
    log = open_log(bag(tmp_path / "bag", changed(kept, "/tf", lost)))
    assert "2 transforms to base_link come from other frames than odom: left out" in log.repairs
    assert log.scan_count == len(sound.scan_rows)


def test_a_mount_in_tf(tmp_path, messages, sound):
    (static,) = [message for topic, _, message in messages if topic == "/tf_static"]

    def moving(message, _):
        stamp = message.transforms[0].header.stamp
        again = [replace(t, header=replace(t.header, stamp=stamp)) for t in static.transforms]
        return replace(message, transforms=[*message.transforms, *again])

    kept = [m for m in messages if m[0] != "/tf_static"]
    log = open_log(bag(tmp_path / "bag", changed(kept, "/tf", moving)))
    assert_like(log.table, sound)
    assert "the mount of laser is taken from /tf" in log.notes


def test_a_mount_in_the_robots_description(tmp_path, messages, sound):
    x, y, theta = sound.mounts[0].tolist()
    urdf = (
        '<robot name="r"><link name="base_link"/><link name="laser"/><joint name="j" type="fixed">'
        f'<parent link="base_link"/><child link="laser"/><origin xyz="{x} {y} 0.2" rpy="0 0 {theta}"/></joint></robot>'
    )
    description = STORE.types["std_msgs/msg/String"](data=urdf)
    kept = [m for m in messages if m[0] != "/tf_static"]
    log = open_log(bag(tmp_path / "bag", [("/robot_description", 0, description), *kept]))
    assert_like(log.table, sound)
    assert "the mount of laser is taken from /robot_description" in log.notes


def test_a_mount_nowhere_is_noted_and_can_be_given(tmp_path, messages, sound):
    path = bag(tmp_path / "bag", [m for m in messages if m[0] != "/tf_static"])
    log = open_log(path)
    assert any("no transform says where laser is mounted" in note and "--laser-offset" in note for note in log.notes)
    np.testing.assert_array_equal(log.table.mounts, 0.0)
    assert_like(open_log(path, laser_offset=float(sound.mounts[0, 0])).table, sound)


def test_odometry_that_starts_again_is_joined(tmp_path, messages, sound):
    point, quaternion = (STORE.types[f"geometry_msgs/msg/{name}"] for name in ("Point", "Quaternion"))
    count = sum(topic == "/odom" for topic, _, _ in messages)
    poses = iter(sound.odometry)
    poses = np.array([next(poses) for _ in range(count)])

    def restarted(message, number):
        if number < count // 2:
            return message
        x, y, theta = se2.between(poses[count // 2], poses[number]).tolist()
        pose = replace(
            message.pose.pose,
            position=point(x, y, 0.0),
            orientation=quaternion(0.0, 0.0, float(np.sin(theta / 2)), float(np.cos(theta / 2))),
        )
        return replace(message, pose=replace(message.pose, pose=pose))

    log = open_log(bag(tmp_path / "bag", changed(messages, "/odom", restarted)))
    assert_like(log.table, sound, atol=0.01)  # the step of 50 ms in between follows the twist
    assert any("the odometry jumps by" in note for note in log.notes)


@pytest.mark.parametrize("increment", [0.0, 0.0175, 0.45, -0.02])
def test_angles_that_contradict_are_refused_with_the_numbers(tmp_path, messages, increment):
    wrong = changed(messages, "/scan", lambda m, _: replace(m, angle_increment=increment))
    with pytest.raises(LogError, match=r"800 readings make an increment of 0\.00785398, angle_increment is"):
        open_log(bag(tmp_path / "bag", wrong))


@pytest.mark.parametrize("beams", [1.0, -1.0])
def test_angles_that_are_off_by_one_are_noted(tmp_path, messages, sound, beams):
    def off(message, _):
        return replace(message, angle_max=message.angle_max + beams * message.angle_increment)

    log = open_log(bag(tmp_path / "bag", changed(messages, "/scan", off)))
    assert_like(log.table, sound)
    np.testing.assert_array_equal(log.table.patterns[0].angles, sound.patterns[0].angles)
    assert any("angle_max is 1.0 beams off" in note for note in log.notes)


@pytest.mark.parametrize("topics", [("/scan",), ("/odom",), ("/scan", "/odom")])
def test_equal_stamps_give_way_to_the_bags_time(tmp_path, messages, sound, topics):
    for topic in topics:
        messages = changed(messages, topic, at_zero)
    log = open_log(bag(tmp_path / "bag", messages))
    assert_like(log.table, sound, atol=1e-6)
    assert sum("the bag's own times are used" in note for note in log.notes) == len(topics)


def test_a_recording_played_twice_counts_once(tmp_path, messages, sound):
    again = [(topic, time + 50 * 10**9, message) for topic, time, message in messages]
    log = open_log(bag(tmp_path / "bag", [*messages, *again]))
    assert_like(log.table, sound)
    assert any("played more than once; the first pass is used" in note for note in log.notes)


@pytest.mark.parametrize("kept", ["metadata", "nothing else"])
def test_a_directory_without_metadata_is_read(tmp_path, messages, sound, kept):
    path = bag(tmp_path / "bag", messages)
    (path / "metadata.yaml").unlink()
    log = open_log(path)
    assert_like(log.table, sound)
    assert "no metadata.yaml: read bag.db3" in log.notes


@pytest.mark.parametrize("fault", ["renamed", "empty", "no yaml"])
def test_a_metadata_that_does_not_name_the_files(tmp_path, messages, sound, fault):
    path = bag(tmp_path / "bag", messages)
    if fault == "renamed":
        (path / "bag.db3").rename(path / "other.db3")
    else:
        (path / "metadata.yaml").write_text("" if fault == "empty" else "rosbag2: [")
    log = open_log(path)
    assert_like(log.table, sound)
    assert any("metadata.yaml does not name the files here: read " in note for note in log.notes)


def test_a_file_that_is_there_twice_counts_once(tmp_path, messages, sound):
    path = bag(tmp_path / "bag", messages)
    (path / "metadata.yaml").unlink()
    shutil.copy(path / "bag.db3", path / "bag_1.db3")
    log = open_log(path)
    assert_like(log.table, sound)
    assert f"{len(sound.scan_rows)} scans are in the bag twice: one of each two is left out" in log.repairs


@pytest.mark.parametrize("share", [0.5, 0.8, 0.999])
def test_an_mcap_file_without_its_end_is_read(tmp_path, source, share):
    content = (source / "drive.mcap").read_bytes()
    (tmp_path / "killed").mkdir()
    (tmp_path / "killed" / "drive.mcap").write_bytes(content[: int(share * len(content))])
    log, whole = open_log(tmp_path / "killed"), open_log(source).table
    count = log.scan_count
    assert 0 < count <= len(whole.scan_rows)
    assert count >= int((share - 0.3) * len(whole.scan_rows))  # the true map comes first, with a quarter of the bytes
    np.testing.assert_array_equal(log.table.ranges, whole.ranges[: whole.scan_starts[count]])
    assert any("the recorder was not stopped properly" in note for note in log.notes)


def test_an_sqlite_file_with_a_journal_is_read(tmp_path, messages, sound):
    path = bag(tmp_path / "bag", messages)
    base = sqlite3.connect(path / "bag.db3")
    base.execute("PRAGMA journal_mode = WAL")
    base.execute("UPDATE messages SET timestamp = timestamp")
    base.commit()
    killed = tmp_path / "killed"
    killed.mkdir()
    for file in path.glob("bag.db3*"):  # as they are while the recorder runs
        shutil.copy(file, killed / file.name)
    base.close()
    assert (killed / "bag.db3-wal").is_file()
    log = open_log(killed)
    assert_like(log.table, sound)
    assert any("not stopped properly" in note for note in log.notes)


@pytest.mark.parametrize("compressed", [False, True])
def test_a_ros1_bag_without_an_index_is_read(tmp_path, source, compressed):
    short = open_log(source).frames
    frames = [replace(frame, stamp=frame.stamp + 8.0 * part) for part in range(5) for frame in short]  # several chunks
    whole = Log.from_frames(frames, path=source, format="made")
    write_log(tmp_path / "drive.bag", whole, "rosbag1", compressed=compressed)
    content = bytearray((tmp_path / "drive.bag").read_bytes())
    at = content.index(b"index_pos=") + 10
    content[at : at + 8] = bytes(8)  # the recorder fills it in at the end
    (tmp_path / "killed.bag").write_bytes(content[: int(0.8 * len(content))])
    log = open_log(tmp_path / "killed.bag")
    count = log.scan_count
    assert 0.5 * whole.scan_count < count < whole.scan_count
    ranges = whole.table.ranges[: whole.table.scan_starts[count]]
    np.testing.assert_array_equal(log.table.ranges, ranges.astype(np.float32))
    assert any("not stopped properly" in note for note in log.notes)


def test_a_time_between_beams_that_cannot_be_is_ignored(tmp_path, messages, sound):
    for number, beat in enumerate((float("nan"), 0.1, -1.0)):
        path = bag(
            tmp_path / f"bag{number}", changed(messages, "/scan", lambda m, _, b=beat: replace(m, time_increment=b))
        )
        log = open_log(path)
        assert_like(log.table, sound)
        assert all(pattern.time_offsets is None for pattern in log.table.patterns)
        assert any(note.startswith("time_increment") for note in log.repairs)


def test_an_increment_against_the_limits_is_refused(tmp_path, messages):
    path = bag(
        tmp_path / "bag", changed(messages, "/scan", lambda m, _: replace(m, angle_increment=-m.angle_increment))
    )
    with pytest.raises(LogError, match=r"contradict each other.*angle_increment is -0\.0078"):
        open_log(path)


@pytest.mark.parametrize("topic", ["/scan", "/odom"])
def test_a_stray_stamp_costs_one_message(tmp_path, messages, sound, topic):
    path = bag(tmp_path / "bag", changed(messages, topic, lambda m, k: at_zero(m) if k == 40 else m))
    log = open_log(path)
    assert any(note.startswith("1 stamps of") for note in log.repairs)
    lost = 1 if topic == "/scan" else 0
    assert log.scan_count == len(sound.scan_rows) - lost


def test_scans_from_where_time_steps_back_are_counted(tmp_path, messages, sound):
    count = len(sound.scan_rows) // 2
    log = open_log(
        bag(tmp_path / "bag", changed(messages, "/scan", lambda m, k: set_back(m, 4.0) if k >= count else m))
    )
    assert log.scan_count == count
    assert any("scans from where their time steps back on are left out" in note for note in log.repairs)


def test_scans_in_a_gap_of_the_odometry_are_counted(tmp_path, messages, sound):
    gone = [m for m in messages if not (m[0] == "/odom" and 3 <= m[2].header.stamp.sec < 5)]
    log = open_log(bag(tmp_path / "bag", gone))
    assert any("scans lie in gaps of the odometry of up to 2.0" in note for note in log.repairs)
    assert not any("gaps of the odometry" in note for note in open_log(bag(tmp_path / "whole", messages)).notes)


def test_a_limit_that_is_no_number_is_noted(tmp_path, messages, sound):
    path = bag(tmp_path / "bag", changed(messages, "/scan", lambda m, _: replace(m, angle_max=float("inf"))))
    log = open_log(path)
    assert_like(log.table, sound)
    assert any(note.startswith("angle_max is inf") for note in log.repairs)


def with_twist(message, linear=1.0, angular=1.0):
    twist = message.twist.twist
    changed_twist = replace(
        twist,
        linear=replace(twist.linear, x=linear * twist.linear.x),
        angular=replace(twist.angular, z=angular * twist.angular.z),
    )
    return replace(message, twist=replace(message.twist, twist=changed_twist))


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """The messages of a drive with turns, and what is read of them."""
    path = tmp_path_factory.mktemp("turning")
    config = SimulationConfig(backend="fast", duration=40.0)
    write_dataset(path / "drive", load("office"), config, {"seed": 0}, log_format="rosbag2-lean")
    with AnyReader([path / "drive"], default_typestore=STORE) as reader:
        found = [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]
    messages = [message for message in found if message[0] in TOPICS]
    log = open_log(bag(path / "bag", messages))
    assert not any("twists" in note for note in log.notes)
    return messages, log.table


@pytest.mark.parametrize(("linear", "angular"), [(0.0, 0.0), (1.0, 0.0), (1.0, 57.2958), (1.0, -1.0), (1000.0, 1.0)])
def test_twists_that_the_poses_contradict_are_not_used(tmp_path, turning, linear, angular):
    messages, sound = turning
    log = open_log(bag(tmp_path / "bag", changed(messages, "/odom", lambda m, _: with_twist(m, linear, angular))))
    assert any("the poses give the velocities" in note for note in log.repairs)
    rows = log.table.scan_rows
    apart = np.abs(log.table.twist[rows] - sound.twist[sound.scan_rows])
    assert np.median(apart, axis=0).max() < 0.05
    assert_like(log.table, sound)


def test_twists_that_no_robot_makes_are_left_out(tmp_path, messages, sound):
    def wild(message, number):
        return with_twist(message, linear=1e9) if number in (20, 60) else message

    log = open_log(bag(tmp_path / "bag", changed(messages, "/odom", wild)))
    assert "2 twists of the odometry are faster than any robot: the poses give the velocities" in log.repairs
    assert np.nanmax(np.abs(log.table.twist)) < 3.0
    assert_like(log.table, sound)


@pytest.mark.parametrize("seconds", [-1_000_000, 3600])
def test_scans_by_another_clock_are_related_by_the_bags_times(tmp_path, messages, sound, seconds):
    def by_other_clock(message, _):
        stamp = message.header.stamp
        return replace(message, header=replace(message.header, stamp=TIME(stamp.sec + seconds, stamp.nanosec)))

    log = open_log(bag(tmp_path / "bag", changed(messages, "/scan", by_other_clock)))
    assert_like(log.table, sound, atol=1e-6)
    assert any("stamps of scans are by another clock" in note for note in log.repairs)


def test_an_odometry_topic_without_messages_gives_way_to_tf(tmp_path, messages, sound):
    path = tmp_path / "bag"
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {}
        for topic, time, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=STORE)
            if topic != "/odom":
                writer.write(connections[topic], time, STORE.serialize_cdr(message, message.__msgtype__))
    assert_like(open_log(path).table, sound)


def test_angles_in_degrees_are_read_as_such(tmp_path, messages, sound):
    def in_degrees(message, _):
        names = ("angle_min", "angle_max", "angle_increment")
        return replace(message, **{name: float(np.degrees(getattr(message, name))) for name in names})

    log = open_log(bag(tmp_path / "bag", changed(messages, "/scan", in_degrees)))
    np.testing.assert_allclose(log.table.patterns[0].angles, sound.patterns[0].angles, atol=1e-4)
    assert any("the angles of the scans are in degrees (-180 to 179.55)" in note for note in log.repairs)
    np.testing.assert_array_equal(log.table.ranges, sound.ranges)


@pytest.mark.parametrize("topic", ["/scan", "/odom"])
def test_stamps_in_whole_seconds_give_way_to_the_bags_time(tmp_path, messages, sound, topic):
    def whole(message, _):
        return replace(message, header=replace(message.header, stamp=TIME(message.header.stamp.sec, 0)))

    log = open_log(bag(tmp_path / "bag", changed(messages, topic, whole)))
    assert_like(log.table, sound, atol=1e-6)
    assert any("repeat the one before: the bag's own times are used" in note for note in log.repairs)


def test_poses_that_are_sent_again_keep_their_stamps(tmp_path, messages, sound):
    again = [(name, time + 1000 * k, m) for name, time, m in messages for k in range(3 if name == "/odom" else 1)]
    log = open_log(bag(tmp_path / "bag", again))
    assert_like(log.table, sound)
    assert not any("own times" in note for note in log.notes)


def test_odometry_without_a_child_frame(tmp_path, messages, sound):
    log = open_log(bag(tmp_path / "bag", changed(messages, "/odom", lambda m, _: replace(m, child_frame_id=""))))
    assert_like(log.table, sound)
    assert "the odometry names no child_frame_id: taken to be that of base_link" in log.repairs


def test_the_topic_that_ends_as_usual_is_chosen(tmp_path, messages, sound):
    new = {"/scan": "/front/scan", "/odom": "/robot/odom"}
    renamed = [(new.get(name, name), time, message) for name, time, message in messages]
    others = [(f"/other{name}_filtered", time, message) for name, time, message in messages if name in new]
    log = open_log(bag(tmp_path / "bag", [*renamed, *others]))
    assert_like(log.table, sound)
    assert "scans from /front/scan, odometry from /robot/odom" in log.notes
    both = [(f"/b{name[6:]}" if name.startswith("/front") else name, t, m) for name, t, m in renamed if "scan" in name]
    with pytest.raises(LogError, match=r"several topics with scans of one lidar, none is /scan: /b/scan, /front/scan"):
        open_log(bag(tmp_path / "both", [*renamed, *both]))


def pose_of(message, x, y, heading):
    """The message with this pose."""
    position = replace(message.pose.pose.position, x=float(x), y=float(y))
    half = 0.5 * float(heading)
    orientation = replace(message.pose.pose.orientation, x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half)))
    pose = replace(message.pose.pose, position=position, orientation=orientation)
    return replace(message, pose=replace(message.pose, pose=pose))


def place_of(message):
    pose = message.pose.pose
    return pose.position.x, pose.position.y, 2.0 * np.arctan2(pose.orientation.z, pose.orientation.w)


@pytest.mark.parametrize("dead", ["pose", "position", "heading"])
def test_what_never_changes_of_a_pose_is_made_of_the_twists(tmp_path, turning, dead):
    def held(message, _):
        x, y, heading = place_of(message)
        if dead != "heading":
            x, y = 1.0, 2.0
        return pose_of(message, x, y, heading if dead == "position" else 0.0)

    messages, sound = turning
    table = open_log(bag(tmp_path / "bag", changed(messages, "/odom", held)))
    assert any(f"the {dead} of the odometry never changes" in note for note in table.repairs)
    moved, true = (se2.between(t.odometry[:1], t.odometry) for t in (table.table, sound))
    apart = se2.between(true, moved)
    length = np.hypot(*np.diff(sound.odometry[:, :2], axis=0).T).sum()
    assert np.hypot(apart[:, 0], apart[:, 1]).max() < 0.05 * length
    assert np.degrees(np.abs(apart[:, 2])).max() < 10.0  # while it turns: 25 ms of 3 rad/s are 4 deg


def test_poses_that_are_held_are_left_out(tmp_path, turning):
    last = {}

    def held(message, number):
        last["pose"] = message.pose if number % 5 == 0 else last["pose"]
        return replace(message, pose=last["pose"])

    messages, sound = turning
    log = open_log(bag(tmp_path / "bag", changed(messages, "/odom", held)))
    assert any("repeat the pose before while their twists say" in note for note in log.repairs)
    truth = np.array([np.interp(log.table.stamps, sound.stamps, column) for column in sound.odometry[:, :2].T]).T
    assert np.abs(log.table.odometry[:, :2] - truth).max() < 0.1  # at the end the last pose is held
    assert np.median(np.abs(log.table.odometry[:, :2] - truth)) < 0.002


def doubled(messages, change):
    """Each message of odometry followed by another one, 10 ms later."""
    twice = []
    for topic, time, message in messages:
        twice.append((topic, time, message))
        if topic == "/odom":
            twice.append((topic, time + 10_000_000, change(set_back(message, -0.01))))
    return twice


@pytest.mark.parametrize("frames", [{"child_frame_id": "imu_link"}, {"child_frame_id": "base_lint"}])
def test_odometry_of_other_frames_on_the_topic_is_left_out(tmp_path, messages, sound, frames):
    def other(message):
        return replace(pose_of(message, 5.0, 5.0, 1.0), **frames)

    log = open_log(bag(tmp_path / "bag", doubled(messages, other)))
    assert_like(log.table, sound)
    assert any("messages of /odom are of other frames than odom to base_link: left out" in note for note in log.repairs)


def test_two_paths_on_one_topic_are_refused(tmp_path, messages):
    path = bag(tmp_path / "bag", doubled(messages, lambda message: pose_of(message, 5.0, 5.0, 1.0)))
    with pytest.raises(LogError, match=r"bag: /odom: the odometry jumps at \d+ of \d+ messages, .* expected one path"):
        open_log(path)
