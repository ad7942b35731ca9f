# SPDX-License-Identifier: MIT
"""ROS bags, written without ROS: rosbag2 directories (MCAP or SQLite) that `ros2 bag play` takes, and ROS 1 bags.

Topics: `/scan`, `/odom`, `/cmd_vel` where the commands are known, `/tf` (odom to base_link), `/tf_static` (base_link to
laser and to the robot's parts), `/robot_description` and, where truth is known, `/ground_truth/odom`,
`/ground_truth/map` and `/ground_truth/tf` (map to odom). Bags that have no check sums of their own end with one on
`/testbed/sha256`. Frames by REP 105: map, odom, base_link, laser. Of several
lidars, each has a frame of its own and a topic `/scan_` with the frame's name.

Viewers such as Rerun draw neither LaserScan nor Odometry: for them the hits are there once more as a point cloud,
`/scan_cloud`, and `/ground_truth/tf` hangs the odometry's frame where it truly is. That is no part of `/tf`, where it
would contradict the mapper that a bag is played to.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from eval.files.atomic_write import atomic_directory
from slam import se2
from slam.occupancy import OccupancyGrid
from testbed.formats.beams import same_mount
from testbed.formats.checksums import SEAL_TOPIC, MessageSum
from testbed.formats.log import LogError
from testbed.formats.ros.mcap_checksums import seal
from testbed.formats.ros.messages import Joint, Messages, joints_of, nanoseconds, planar_joint
from testbed.frame import Frame

Storage = Literal["mcap", "sqlite", "rosbag1"]

LATEST_STAMP = 2**31 - 1
"""ROS 2 counts seconds in 31 bits."""
LATCHED = ("/tf_static", "/robot_description", "/ground_truth/map")
"""Topics of one message that late subscribers still receive."""

Put = Callable[[str, float, Any], None]
"""Writes a message: topic, time [s], message."""


class _Bag(NamedTuple):
    """A bag that is being written."""

    types: Any
    """Message types by name."""
    put: Put
    total: MessageSum
    """Of what was put so far."""


def write_bag(
    path: str | Path,
    frames: Sequence[Frame],
    *,
    storage: Storage = "mcap",
    truth_map: OccupancyGrid | None = None,
    robot_urdf: str | None = None,
    cloud: bool = True,
) -> None:
    """Write frames as a bag `path`, which must not exist; equal frames give equal bytes.

    storage: mcap, sqlite: a rosbag2 directory (metadata.yaml and one file);  rosbag1: one file, for ROS 1
    robot_urdf: the robot as URDF text with the root link base_link; its joints are written at rest
    cloud: write the point clouds too, which more than doubles the size of a bag

    ROS holds ranges and angles as float32, all poses as float64, stamps in nanoseconds. Raises LogError where stamps
    step backwards (a bag is ordered by time) or are out of ROS's range, where beams or their times are not evenly
    spaced, or where scans of one lidar differ in mount. The bag is written aside and renamed.
    """
    path = Path(path)
    if path.exists():
        raise LogError(f"{path}: exists")
    mounts = _mounts(path, frames)
    with atomic_directory(path) as aside:
        with _rosbag1(aside) if storage == "rosbag1" else _rosbag2(aside, storage) as bag:
            make = Messages(bag.types)
            try:
                _put_all(make, bag.put, frames, mounts, truth_map, robot_urdf, cloud)
            except LogError as error:
                raise LogError(f"{path}: {error}") from None
            if storage != "mcap":
                bag.put(SEAL_TOPIC, frames[-1].stamp, make.text(bag.total.text))
        if storage == "mcap":
            seal(aside / f"{aside.name}.mcap")


def _mounts(path: Path, frames: Sequence[Frame]) -> dict[str, tuple[float, float, float]]:
    """Mount of each lidar, by name; LogError where a bag cannot hold these frames."""
    if not frames:
        raise LogError(f"{path}: no frames to write")
    stamps = np.array([frame.stamp for frame in frames])
    back = np.flatnonzero(np.diff(stamps) < 0.0)
    if back.size:
        raise LogError(f"{path}: frame {back[0] + 1}: the stamps step backwards; a bag is ordered by time")
    if not (stamps[0] >= 0.0 and stamps[-1] < LATEST_STAMP):
        raise LogError(f"{path}: stamps from {stamps[0]:g} to {stamps[-1]:g} s, expected 0 to {LATEST_STAMP}")
    mounts: dict[str, tuple[float, float, float]] = {}
    for frame in frames:
        if frame.scan is None:
            continue
        first = mounts.setdefault(frame.lidar, frame.scan.mount)
        if not same_mount(frame.scan.mount, first):
            raise LogError(f"{path}: scans of one lidar ({frame.lidar}) mounted at different places")
    topics = scan_topics(list(mounts))
    if len(set(topics.values())) < len(topics):
        raise LogError(f"{path}: lidars whose names differ in signs alone: {', '.join(topics)}")
    return mounts


def scan_topics(lidars: Sequence[str]) -> dict[str, str]:
    """Topic of each lidar's scans, by the name of its frame."""
    if len(lidars) == 1:
        return {lidars[0]: "/scan"}
    return {name: f"/scan_{re.sub(r'[^A-Za-z0-9_]', '_', name)}" for name in lidars}


@contextmanager
def _rosbag2(path: Path, storage: Literal["mcap", "sqlite"]) -> Iterator[_Bag]:
    """A new rosbag2 directory."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    connections: dict[str, Any] = {}
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    total = MessageSum()
    with Writer(path, version=9, storage_plugin=plugin) as writer:

        def put(topic: str, stamp: float, message: Any) -> None:
            kind = message.__msgtype__
            if topic not in connections:
                qos = [_latched()] if topic in LATCHED else []
                connections[topic] = writer.add_connection(topic, kind, typestore=store, offered_qos_profiles=qos)
            raw = store.serialize_cdr(message, kind)
            total.add(topic, nanoseconds(stamp), raw)
            writer.write(connections[topic], nanoseconds(stamp), raw)

        yield _Bag(store.types, put, total)


@contextmanager
def _rosbag1(path: Path) -> Iterator[_Bag]:
    """A new ROS 1 bag; packed by bzip2, whose check sums tell damage."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    connections: dict[str, Any] = {}
    total = MessageSum()
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.BZ2)
    with writer:

        def put(topic: str, stamp: float, message: Any) -> None:
            kind = message.__msgtype__
            if topic not in connections:
                latching = int(topic in LATCHED)
                connections[topic] = writer.add_connection(topic, kind, typestore=store, latching=latching)
            raw = store.serialize_ros1(message, kind)
            total.add(topic, nanoseconds(stamp), raw)
            writer.write(connections[topic], nanoseconds(stamp), raw)

        yield _Bag(store.types, put, total)


def _put_all(
    make: Messages,
    put: Put,
    frames: Sequence[Frame],
    mounts: dict[str, tuple[float, float, float]],
    truth_map: OccupancyGrid | None,
    robot_urdf: str | None,
    cloud: bool,
) -> None:
    start, topics = frames[0].stamp, scan_topics(list(mounts))
    put("/tf_static", start, make.transforms(start, _static_joints(mounts, robot_urdf)))  # late subscribers get one
    if robot_urdf is not None:
        put("/robot_description", start, make.text(robot_urdf))
    if truth_map is not None:
        put("/ground_truth/map", start, make.map(start, truth_map))
    for index, frame in enumerate(frames):
        stamp = frame.stamp
        put("/odom", stamp, make.odometry(stamp, "odom", frame.odometry, frame.twist))
        put("/tf", stamp, make.transforms(stamp, [planar_joint("odom", "base_link", frame.odometry)]))
        if frame.command is not None:
            speed, turn_rate = frame.command
            put("/cmd_vel", stamp, make.twist(speed, 0.0, turn_rate))
        if frame.truth is not None:
            T_map_odom = se2.compose(frame.truth, se2.inverse(frame.odometry))
            put("/ground_truth/odom", stamp, make.odometry(stamp, "map", frame.truth, None))
            put("/ground_truth/tf", stamp, make.transforms(stamp, [planar_joint("map", "odom", T_map_odom)]))
        if frame.scan is not None:
            try:
                put(topics[frame.lidar], stamp, make.scan(stamp, frame.lidar, frame.scan))
            except ValueError as error:
                raise LogError(f"frame {index}: {error}") from None
            if cloud:
                put(f"{topics[frame.lidar]}_cloud", stamp, make.cloud(stamp, frame.lidar, frame.scan))


def _static_joints(mounts: dict[str, tuple[float, float, float]], robot_urdf: str | None) -> list[Joint]:
    lidars = [planar_joint("base_link", name, np.array(mount)) for name, mount in mounts.items()]
    return lidars if robot_urdf is None else [*lidars, *joints_of(robot_urdf)]


def _latched() -> Any:
    """Quality of service of topics that late subscribers still receive."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    forever = QosTime(2147483647, 4294967295)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        forever,
        forever,
        QosLiveliness.AUTOMATIC,
        forever,
        False,
    )
