# SPDX-License-Identifier: MIT
"""ROS bags, read without ROS: rosbag2 directories (MCAP, SQLite), single `.mcap` or `.db3` files, ROS 1 `.bag` files.

Scans are `sensor_msgs/LaserScan` or `MultiEchoLaserScan`, odometry `nav_msgs/Odometry`, truth the same or stamped
poses, commands `geometry_msgs/Twist`, the true map `nav_msgs/OccupancyGrid`; the lidars' mounts come from the static
transforms. Frames by REP 105: the odometry's `child_frame_id` is the robot, and the frame of a scan tells which lidar
took it.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from sys import intern
from typing import Any

import numpy as np

from slam.occupancy import OccupancyGrid
from testbed.formats.checksums import SEAL_TOPIC, MessageSum, verify
from testbed.formats.log import Log, LogError, shortened
from testbed.formats.ros.layouts import Encoding
from testbed.formats.ros.packing import messages
from testbed.formats.ros.reading.clocks import first_pass, in_one_pass, one_clock, true_path
from testbed.formats.ros.reading.clouds import peek_clouds, read_clouds
from testbed.formats.ros.reading.content import BagContent, Heights, RawMessage
from testbed.formats.ros.reading.decode import (
    BadMessageError,
    RawScan,
    decode_commands,
    decode_echoes,
    decode_odometry,
    decode_scan,
    decode_truth,
    publishers,
    seconds,
)
from testbed.formats.ros.reading.frames import assemble
from testbed.formats.ros.reading.missing_transforms import complete_transforms
from testbed.formats.ros.reading.topics import (
    CLOUD_TYPE,
    DESCRIPTION,
    ECHO_TYPE,
    ODOMETRY_TYPE,
    TRANSFORM_TYPES,
    choose_topics,
)
from testbed.formats.ros.reading.transforms import ROBOT_FRAMES, planar_pose
from testbed.formats.ros.salvage import readable

MAX_HEADS = 1000
"""Different heads of scans that are kept once; of scans that all differ nothing is gained."""
MAX_CELLS = 100_000_000
"""Cells."""
MAX_METADATA = 1_000_000
"""Bytes of a metadata.yaml."""


def read_bag(
    path: Path,
    *,
    laser_offset: float | None = None,
    range_max: float | None = None,
    heights: Heights | None = None,
) -> Log:
    """Read a ROS bag; frames are sorted by the stamps in the messages' headers.

    laser_offset [m]: the lidar sits this far ahead of the robot's centre, whatever the transforms say; range_max [m]
    overrides what the scans say; heights [m]: scans are made of the points of clouds between them. Topics are chosen by
    type: of several, `/odom` and `/cmd_vel`, and of several with scans of one lidar (one frame) `/scan`. Odometry and
    truth are interpolated at the scans' stamps, a frame's command is the latest one; scans outside of the odometry's
    time are left out and counted, as are topics.
    Raises LogError, naming the file and the place, for damaged bags, missing topics, clocks that do not meet, and
    values that make no sense.
    """
    if path.is_dir():
        verify(path)
    metadata = path / "metadata.yaml"
    if metadata.is_file() and metadata.stat().st_size > MAX_METADATA:
        raise LogError(f"{metadata}: larger than {MAX_METADATA} bytes")
    content = BagContent(laser_offset=laser_offset, heights=heights)
    with _complaints(path, content), readable(path) as (paths, notes):
        content.notes += notes
        _read_messages(path, paths, content)
    if not len(content.odometry.stamps):
        raise LogError(f"{path}: no odometry: the topic {content.topics['odometry']} is empty")
    return assemble(path, content, range_max)


@contextmanager
def _complaints(path: Path, content: BagContent) -> Iterator[None]:
    """Turn whatever a damaged bag raises deep inside the readers into one line with the file and the place."""
    try:
        yield
    except LogError:
        raise
    except Exception as error:  # struct, SQLite, YAML, codecs, message definitions: all mean a damaged bag
        reason = shortened(" ".join(str(error).split())) or type(error).__name__
        raise LogError(f"{path}: damaged or unreadable bag, after {content.messages} messages: {reason}") from None


def _read_messages(path: Path, paths: list[Path], content: BagContent) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader(paths, default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        wanted = choose_topics(path, reader, content)
        clouds = [connection for connection in wanted if connection.msgtype == CLOUD_TYPE]
        wanted = [connection for connection in wanted if connection not in clouds]
        sealed, total, seal = any(c.topic == SEAL_TOPIC for c in reader.connections), MessageSum(), ""
        raws: dict[str, tuple[Any, list[RawMessage]]] = {}
        scans: dict[str, tuple[array[int], list[RawScan]]] = {}  # with the bag's times
        for connection, time, raw in messages(reader, reader.connections if sealed else wanted):
            if connection.topic == SEAL_TOPIC:
                seal = str(getattr(reader.deserialize(raw, connection.msgtype), "data", ""))
                continue
            if sealed:
                total.add(connection.topic, time, raw)
            if connection not in wanted:
                continue
            content.messages += 1
            if connection.topic in content.scans:  # the larger part of a bag: its messages are not kept
                times, of_topic = scans.setdefault(connection.topic, (array("q"), []))
                times.append(time)
                of_topic.append(_read_scan(content, connection, raw, reader))
                continue
            raws.setdefault(connection.topic, (connection, []))[1].append(RawMessage(content.messages, time, raw))
        if sealed and seal != total.text:
            raise LogError(f"{path}: damaged bag: its messages differ from the SHA-256 in {SEAL_TOPIC}")
        odometry = content.topics["odometry"]  # first, since its clock mends others
        for topic in sorted(raws, key=lambda topic: topic != odometry):
            connection, serialised = raws[topic]
            try:
                _decode(content, connection, serialised, reader)
            except BadMessageError as error:
                raise LogError(f"{path}: message {serialised[error.number].number} ({topic}): {error}") from None
        for topic, (times, of_topic) in scans.items():
            content.scans[topic] = in_one_pass(content, times, of_topic)
        peek_clouds(content, reader, clouds)
        try:
            complete_transforms(path, content, raws, reader)
            if clouds:
                read_clouds(path, content, reader, clouds)
        except ValueError as error:
            raise error if isinstance(error, LogError) else LogError(f"{path}: transforms: {error}") from None


def _read_scan(content: BagContent, connection: Any, raw: bytes, reader: Any) -> RawScan:
    """Decode a scan, whose readings go to the store."""

    def deserialise(raw: bytes) -> Any:
        return reader.deserialize(raw, connection.msgtype)

    if connection.msgtype == ECHO_TYPE:
        scan = decode_echoes(raw, deserialise)
    else:
        scan = decode_scan(raw, "cdr" if reader.is2 else "ros1", deserialise)
    head: tuple[Any, ...] = scan[1 : RawScan._fields.index("ranges")]
    if len(content.heads) < MAX_HEADS:
        head = content.heads.setdefault(head, head)
    source = intern(f"message {{}} ({connection.topic})")
    return RawScan._make((scan.stamp, *head, content.readings.keep(scan.ranges), content.messages, source))


def _decode(content: BagContent, connection: Any, raws: list[RawMessage], reader: Any) -> None:
    """Decode all messages of a topic without scans; BadMessageError where one makes no sense."""
    topic, topics = connection.topic, content.topics
    encoding: Encoding = "cdr" if reader.is2 else "ros1"
    data = [raw.data for raw in raws]

    def deserialise(raw: bytes) -> Any:
        return reader.deserialize(raw, connection.msgtype)

    if connection.msgtype in TRANSFORM_TYPES:
        if "static" in topic:  # moving joints are no mount
            _one_by_one(data, lambda raw: content.transforms.add(deserialise(raw)))
    elif topic == DESCRIPTION:
        content.robot_urdf = deserialise(data[-1]).data
    elif topic == topics.get("commands"):
        content.commands = decode_commands(data, [raw.time for raw in raws], encoding, deserialise)
    elif topic == topics.get("map"):
        _one_by_one(data[-1:], lambda raw: setattr(content, "truth_map", _grid(deserialise(raw))))
    elif topic == topics["odometry"]:
        kept = _of_one_publisher(content, topic, raws, encoding)
        track = decode_odometry([raw.data for raw in kept], encoding, deserialise)
        content.odometry = one_clock(content, np.array([seconds(raw.time) for raw in kept]), track)
    else:
        _decode_truth(content, connection, raws, encoding, deserialise)


def _of_one_publisher(content: BagContent, topic: str, raws: list[RawMessage], encoding: Encoding) -> list[RawMessage]:
    """The messages of odometry of one pair of frames, where several programs send to its topic: that of the robot's
    base, else the most frequent one."""
    pairs = publishers([raw.data for raw in raws], encoding)
    named = Counter(pair for pair in pairs if all(pair))
    if len(named) < 2:
        return raws
    chosen = max(named, key=lambda pair: (pair[0] == "odom" and pair[1] in ROBOT_FRAMES, named[pair]))
    kept = [raw for raw, pair in zip(raws, pairs, strict=True) if pair == chosen]
    content.notes.append(
        f"{len(raws) - len(kept)} messages of {topic} are of other frames than {chosen[0]} to {chosen[1]}: left out"
    )
    return kept


def _decode_truth(
    content: BagContent,
    connection: Any,
    raws: list[RawMessage],
    encoding: Encoding,
    deserialise: Callable[[bytes], Any],
) -> None:
    """Decode the true poses; those of another kind than Odometry are left out, with a note, where they are none in the
    plane: they may be those of a camera."""
    data = [raw.data for raw in raws]
    if connection.msgtype == ODOMETRY_TYPE:
        truth = decode_odometry(data, encoding, deserialise)
    else:
        try:
            truth = decode_truth(data, connection.msgtype, deserialise)
        except BadMessageError as error:
            content.notes.append(f"{connection.topic} is not used as truth: pose {error.number + 1}: {error}")
            return
        if len(truth.stamps) > 1 and float(np.ptp(truth.stamps)) == 0.0:
            content.notes.append(
                f"{connection.topic} is not used as truth: all poses have the stamp {truth.stamps[0]:g} s"
            )
            return
    if len(truth.stamps) == len(raws):
        content.truth = true_path(content, np.array([seconds(raw.time) for raw in raws]), truth)
    else:  # the poses of one message
        content.truth = truth.first(first_pass(truth.stamps))


def _one_by_one(raws: list[bytes], take: Callable[[bytes], None]) -> None:
    """Take messages; BadMessageError with the number of the one that makes no sense."""
    for number, raw in enumerate(raws):
        try:
            take(raw)
        except ValueError as error:
            raise BadMessageError(number, str(error)) from None


def _grid(message: Any) -> OccupancyGrid:
    """An OccupancyGrid message; ValueError where it is too large or makes no sense."""
    info = message.info
    if not 0 < info.width * info.height <= MAX_CELLS:
        raise ValueError(f"a map of {info.width} x {info.height} cells, expected 1 to {MAX_CELLS}")
    if len(message.data) != info.width * info.height or not 0.0 < info.resolution < math.inf:
        raise ValueError(f"a map of {info.width} x {info.height} cells of {info.resolution} m with {len(message.data)}")
    percent = np.asarray(message.data, dtype=np.float32).reshape(info.height, info.width)
    x, y, theta = planar_pose(info.origin.position, info.origin.orientation).tolist()
    return OccupancyGrid(
        probability=np.where(percent < 0.0, np.float32(np.nan), percent / np.float32(100.0)),
        resolution=float(str(np.float32(info.resolution))),  # 0.05, not the float32 next to it
        origin=(x, y, theta),
    )
