# SPDX-License-Identifier: MIT
"""ROS bags, read without ROS: rosbag2 directories (MCAP, SQLite), single `.mcap` or `.db3` files, ROS 1 `.bag` files.

Scans are `sensor_msgs/LaserScan` or `MultiEchoLaserScan`, odometry `nav_msgs/Odometry`, truth the same or stamped
poses, commands `geometry_msgs/Twist`, the true map `nav_msgs/OccupancyGrid`; the lidars' mounts come from the static
transforms. Frames by REP 105: the odometry's `child_frame_id` is the robot, and the frame of a scan tells which lidar
took it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from testbed.formats.checksums import SEAL_TOPIC, MessageSum, verify
from testbed.formats.log import Log, LogError, shortened
from testbed.formats.ros.packing import messages
from testbed.formats.ros.reading.clouds import peek_clouds, read_clouds
from testbed.formats.ros.reading.content import WHOLE, BagContent, RawMessage, Selection
from testbed.formats.ros.reading.frames import assemble
from testbed.formats.ros.reading.intake import Intake
from testbed.formats.ros.reading.missing_transforms import complete_transforms
from testbed.formats.ros.reading.topics import CLOUD_TYPE, TRANSFORM_TYPES, choose_topics
from testbed.formats.ros.salvage import readable

MAX_METADATA = 1_000_000
"""Bytes of a metadata.yaml."""


def read_bag(
    path: Path,
    *,
    laser_offset: float | None = None,
    range_max: float | None = None,
    selection: Selection = WHOLE,
) -> Log:
    """Read a ROS bag; frames are sorted by the stamps in the messages' headers.

    laser_offset [m]: the lidar sits this far ahead of the robot's centre, whatever the transforms say; range_max [m]
    overrides what the scans say; selection: what is read of a bag that holds more. Topics are chosen by type: of
    several, `/odom` and `/cmd_vel`, and of several with scans of one lidar (one frame) `/scan`. Odometry and truth are
    interpolated at the scans' stamps, a frame's command is the latest one; scans outside of the odometry's time are
    left out and counted, as are topics.
    Raises LogError, naming the file and the place, for damaged bags, missing topics, clocks that do not meet, and
    values that make no sense.
    """
    if path.is_dir():
        verify(path)
    metadata = path / "metadata.yaml"
    if metadata.is_file() and metadata.stat().st_size > MAX_METADATA:
        raise LogError(f"{metadata}: larger than {MAX_METADATA} bytes")
    content = BagContent(laser_offset=laser_offset, selection=selection)
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
        moving = [c for c in wanted if c.msgtype in TRANSFORM_TYPES and "static" not in c.topic]
        wanted = [connection for connection in wanted if connection not in moving]  # joints that move are no mount
        sealed, total, seal = any(c.topic == SEAL_TOPIC for c in reader.connections), MessageSum(), ""
        intake = Intake(content, reader)
        for connection, time, raw in messages(reader, reader.connections if sealed else wanted):
            if connection.topic == SEAL_TOPIC:
                seal = str(getattr(reader.deserialize(raw, connection.msgtype), "data", ""))
                continue
            if sealed:
                total.add(connection.topic, time, raw)
            if connection in wanted:
                content.messages += 1
                intake.take(connection, RawMessage(content.messages, time, raw))
        if sealed and seal != total.text:
            raise LogError(f"{path}: damaged bag: its messages differ from the SHA-256 in {SEAL_TOPIC}")
        intake.finish(path)
        peek_clouds(content, reader, clouds)
        try:
            complete_transforms(path, content, moving, reader)
            if clouds:
                read_clouds(path, content, reader, clouds)
        except ValueError as error:
            raise error if isinstance(error, LogError) else LogError(f"{path}: transforms: {error}") from None
