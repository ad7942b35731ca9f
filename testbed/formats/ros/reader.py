# SPDX-License-Identifier: MIT
"""ROS bags, read without ROS: rosbag2 directories (MCAP, SQLite), single `.mcap` or `.db3` files, ROS 1 `.bag` files.

Scans are `sensor_msgs/LaserScan`, odometry and truth `nav_msgs/Odometry`, commands `geometry_msgs/Twist`, the true map
`nav_msgs/OccupancyGrid`; the lidars' mounts come from the static transforms. Frames by REP 105: the odometry's
`child_frame_id` is the robot, and the frame of a scan tells which lidar took it.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose
from testbed.formats.checksums import SEAL_TOPIC, MessageSum, verify
from testbed.formats.log import Log, LogError
from testbed.formats.ros.mcap import verify_mcap
from testbed.formats.ros.transforms import Transforms, planar_pose
from testbed.frame import Frame

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
TRANSFORM_TYPE = "tf2_msgs/msg/TFMessage"
COMMAND_TYPES = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
MAP_TYPE = "nav_msgs/msg/OccupancyGrid"
DESCRIPTION = "/robot_description"
COMMANDS = "/cmd_vel"
MAX_CELLS = 100_000_000
"""Cells."""
TRUTH_WORDS = ("ground_truth", "truth", "groundtruth")
"""A topic whose name contains one of these words holds the true pose."""
MAX_METADATA = 1_000_000
"""Bytes of a metadata.yaml."""
ODOMETRY_REACH = 0.2
"""A scan may lie outside of the odometry's time by this much [s], one period of slow odometry."""


def read_bag(path: Path, *, range_max: float | None = None) -> Log:
    """Read a ROS bag; frames are sorted by the stamps in the messages' headers.

    range_max [m] overrides what the scans say. Topics are chosen by type: of several, `/odom` and `/cmd_vel`, and of
    several with scans of one lidar (one frame) `/scan`. Odometry and truth are interpolated at the scans' stamps, a
    frame's command is the latest one; scans outside of the odometry's time are left out and counted, as are topics.
    Raises LogError, naming the file and the place, for damaged bags, missing topics, clocks that do not meet, and
    values that make no sense.
    """
    if path.is_dir():
        verify(path)
    content = _Content()
    with _complaints(path, content):
        for part in sorted(path.glob("*.mcap")) if path.is_dir() else [path]:
            if part.suffix == ".mcap":
                verify_mcap(part)
        _read_messages(path, content)
    if not content.odometry.stamps:
        raise LogError(f"{path}: no odometry: the topic {content.topics['odometry']} is empty")
    return _assemble(path, content, range_max)


@dataclass
class _Track:
    """Stamped poses of one Odometry topic, in the order of the bag."""

    stamps: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    twists: list[Pose] = field(default_factory=list)
    child_frame: str = ""

    def take(self, message: Any) -> None:
        """Append an Odometry message; ValueError where its pose makes no sense."""
        pose = planar_pose(message.pose.pose.position, message.pose.pose.orientation)
        self.stamps.append(_stamp(message))
        self.poses.append(pose)
        linear, angular = message.twist.twist.linear, message.twist.twist.angular
        self.twists.append(np.array([linear.x, linear.y, angular.z]))
        self.child_frame = self.child_frame or message.child_frame_id

    def in_time(self) -> tuple[NDArray[np.float64], Pose, Pose]:
        """Stamps (n,), poses (n, 3) and twists (n, 3) sorted by time; of equal stamps the first counts."""
        stamps, rows = np.unique(np.array(self.stamps), return_index=True)
        return stamps, np.array(self.poses)[rows], np.array(self.twists)[rows]


class _SeenScan(NamedTuple):
    """A scan before the transforms are known."""

    stamp: float
    place: str
    """File, message and topic, for complaints."""
    message: Any


@dataclass
class _Content:
    topics: dict[str, str] = field(default_factory=dict)
    """Of odometry, truth, commands, map: as far as there are any."""
    others: list[str] = field(default_factory=list)
    """What is left out, for the user's eyes."""
    scans: dict[str, list[_SeenScan]] = field(default_factory=dict)
    """By topic."""
    odometry: _Track = field(default_factory=_Track)
    truth: _Track = field(default_factory=_Track)
    commands: list[tuple[float, float, float]] = field(default_factory=list)
    """Stamp [s], speed [m/s], turn rate [rad/s], in the order of the bag."""
    transforms: Transforms = field(default_factory=Transforms)
    truth_map: OccupancyGrid | None = None
    robot_urdf: str | None = None
    messages: int = 0


@contextmanager
def _complaints(path: Path, content: _Content) -> Iterator[None]:
    """Turn whatever a damaged bag raises deep inside the readers into one line with the file and the place."""
    try:
        yield
    except LogError:
        raise
    except Exception as error:  # struct, SQLite, YAML, codecs, message definitions: all mean a damaged bag
        reason = " ".join(str(error).split()) or type(error).__name__
        raise LogError(f"{path}: damaged or unreadable bag, after {content.messages} messages: {reason}") from None


def _read_messages(path: Path, content: _Content) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    metadata = path / "metadata.yaml"
    if path.is_dir() and metadata.stat().st_size > MAX_METADATA:
        raise LogError(f"{metadata}: larger than {MAX_METADATA} bytes")
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        wanted = _choose_topics(path, reader, content)
        topics = {connection.topic for connection in wanted}
        sealed, total, seal = any(c.topic == SEAL_TOPIC for c in reader.connections), MessageSum(), ""
        for connection, time, raw in reader.messages(connections=reader.connections if sealed else wanted):
            if connection.topic == SEAL_TOPIC:
                seal = str(getattr(reader.deserialize(raw, connection.msgtype), "data", ""))
                continue
            if sealed:
                total.add(connection.topic, time, raw)
            if connection.topic not in topics:
                continue
            content.messages += 1
            if connection.msgtype == TRANSFORM_TYPE and "static" not in connection.topic:
                continue  # moving joints are no mount
            _take(path, content, connection, time, reader.deserialize(raw, connection.msgtype))
        if sealed and seal != total.text:
            raise LogError(f"{path}: damaged bag: its messages differ from the SHA-256 in {SEAL_TOPIC}")


def _choose_topics(path: Path, reader: Any, content: _Content) -> list[Any]:
    """Connections that are to be read; what they are for goes into `content`."""
    by_type: defaultdict[str, set[str]] = defaultdict(set)
    for connection in reader.connections:
        by_type[connection.msgtype].add(connection.topic)
    poses, maps = sorted(by_type[ODOMETRY_TYPE]), sorted(by_type[MAP_TYPE])
    truths = [topic for topic in poses if _is_ground_truth(topic)]
    others = [topic for topic in poses if topic not in truths]
    commands = sorted(set().union(*(by_type[kind] for kind in COMMAND_TYPES)))
    content.scans = {topic: [] for topic in sorted(by_type[SCAN_TYPE])}
    content.topics = {"odometry": _choose(path, ODOMETRY_TYPE, others, "/odom", reader)}
    if truths:
        content.topics["truth"] = truths[0]
    if COMMANDS in commands or len(commands) == 1:
        content.topics["commands"] = COMMANDS if COMMANDS in commands else commands[0]
    if true_maps := [topic for topic in maps if _is_ground_truth(topic)]:
        content.topics["map"] = true_maps[0]
    taken = {*content.topics.values(), *content.scans, *(by_type["std_msgs/msg/String"] & {DESCRIPTION})}
    wanted = [c for c in reader.connections if c.topic in taken or c.msgtype == TRANSFORM_TYPE]
    derived = {SEAL_TOPIC, *(f"{topic}_cloud" for topic in content.scans)}
    content.others = sorted(
        {
            f"{c.topic} ({c.msgtype}, {c.msgcount} messages)"
            for c in reader.connections
            if c not in wanted and c.topic not in derived
        }
    )
    return wanted


def _is_ground_truth(topic: str) -> bool:
    return any(word in topic.lower() for word in TRUTH_WORDS)


def _choose(path: Path, kind: str, topics: list[str], usual: str, reader: Any) -> str:
    if not topics:
        there = ", ".join(sorted({f"{c.topic} ({c.msgtype})" for c in reader.connections})[:8]) or "nothing"
        raise LogError(f"{path}: no topic of type {kind}; there is: {there}")
    if len(topics) > 1 and usual not in topics:
        raise LogError(f"{path}: several topics of type {kind} and none is {usual}: {', '.join(topics)}")
    return usual if usual in topics else topics[0]


def _take(path: Path, content: _Content, connection: Any, time: int, message: Any) -> None:
    topic, topics = connection.topic, content.topics
    place = f"{path}: message {content.messages} ({topic})"
    try:
        if connection.msgtype == TRANSFORM_TYPE:
            content.transforms.add(message)
        elif topic == DESCRIPTION:
            content.robot_urdf = message.data
        elif topic in content.scans:
            content.scans[topic].append(_SeenScan(_stamp(message), place, message))
        elif topic == topics.get("commands"):
            content.commands.append(_command(time, message))
        elif topic == topics.get("map"):
            content.truth_map = _grid(message)
        else:
            (content.odometry if topic == topics["odometry"] else content.truth).take(message)
    except ValueError as error:
        raise LogError(f"{place}: {error}") from None


def _stamp(message: Any) -> float:
    time = message.header.stamp
    return _seconds(time.sec * 1_000_000_000 + time.nanosec)


def _seconds(nanoseconds: int) -> float:
    return nanoseconds / 1_000_000_000  # division of integers: correctly rounded


def _command(time: int, message: Any) -> tuple[float, float, float]:
    """Stamp, speed and turn rate; only stamped messages have a clock of their own."""
    stamp, twist = (_stamp(message), message.twist) if hasattr(message, "header") else (_seconds(time), message)
    speed, turn_rate = float(twist.linear.x), float(twist.angular.z)
    if not (math.isfinite(speed) and math.isfinite(turn_rate)):
        raise ValueError(f"expected a finite command, got {speed} m/s and {turn_rate} rad/s")
    return stamp, speed, turn_rate


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


def _assemble(path: Path, content: _Content, range_max: float | None) -> Log:
    stamps, poses, twists = content.odometry.in_time()
    scans, repeated = _one_topic_per_lidar(path, content)
    reachable = [s for s in scans if stamps[0] - ODOMETRY_REACH <= s.stamp <= stamps[-1] + ODOMETRY_REACH]
    if scans and not reachable:
        raise LogError(
            f"{path}: the clocks of scans and odometry do not meet: scans from {scans[0].stamp:.3f} to "
            f"{scans[-1].stamp:.3f} s, odometry from {stamps[0]:.3f} to {stamps[-1]:.3f} s"
        )
    with_scan = {seen.stamp for seen in reachable}  # their frames tell the odometry of the same stamp already
    frames = [
        Frame(stamp=float(t), odometry=pose, twist=_finite(twist))
        for t, pose, twist in zip(stamps, poses, twists, strict=True)
        if float(t) not in with_scan
    ]
    for seen in reachable:
        at = int(np.clip(np.searchsorted(stamps, seen.stamp), 0, len(stamps) - 1))
        frames.append(
            Frame(
                stamp=seen.stamp,
                odometry=interpolate(stamps, poses, seen.stamp),
                scan=_scan(seen, content, range_max),
                lidar=seen.message.header.frame_id,
                twist=_finite(twists[at]),
            )
        )
    frames.sort(key=lambda frame: frame.stamp)
    chosen = " and ".join(topic for topic in content.scans if topic not in repeated) or "nowhere"
    notes = [f"scans from {chosen}, odometry from {content.topics['odometry']}"]
    if len(reachable) < len(scans):
        outside = len(scans) - len(reachable)
        notes.append(f"{outside} of {len(scans)} scans lie outside of the odometry's time and are left out")
    if left_out := [*(f"{topic} (the same lidar)" for topic in repeated), *content.others]:
        notes.append(f"topics left out: {', '.join(left_out[:8])}{' and others' if left_out[8:] else ''}")
    return Log.from_frames(
        _with_commands(_attach_truth(frames, content.truth), content.commands),
        path=path,
        format="ROS bag",
        notes=tuple(notes),
        truth_map=content.truth_map,
        robot_urdf=content.robot_urdf,
    )


def _one_topic_per_lidar(path: Path, content: _Content) -> tuple[list[_SeenScan], list[str]]:
    """The scans of all lidars in the order of time, and the topics that are left out: scans with the same frame are
    the same lidar's, once more or processed somehow."""
    by_lidar: defaultdict[str, list[str]] = defaultdict(list)
    for topic, scans in content.scans.items():
        for name in sorted({seen.message.header.frame_id for seen in scans}):
            by_lidar[name].append(topic)
    chosen = set()
    for topics in by_lidar.values():
        if len(topics) > 1 and "/scan" not in topics:
            raise LogError(f"{path}: several topics with scans of one lidar, none is /scan: {', '.join(topics)}")
        chosen.add("/scan" if "/scan" in topics else topics[0])
    kept = [seen for topic in sorted(chosen) for seen in content.scans[topic]]
    return sorted(kept, key=lambda seen: seen.stamp), [topic for topic in content.scans if topic not in chosen]


def interpolate(stamps: NDArray[np.float64], poses: Pose, stamp: float) -> Pose:
    """Pose (3,) at `stamp` between its neighbours in time, along a constant motion; beyond the ends the nearest.

    stamps (n,) increasing [s];  poses (n, 3)
    """
    after = int(np.searchsorted(stamps, stamp))
    if after == 0 or after == len(stamps):
        end: Pose = poses[min(after, len(stamps) - 1)].copy()
        return end
    share = (stamp - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
    if share == 1.0:  # exactly, where the frame was written with its odometry
        there: Pose = poses[after].copy()
        return there
    step = se2.between(poses[after - 1], poses[after])
    return se2.compose(poses[after - 1], share * step)


def _attach_truth(frames: list[Frame], truth: _Track) -> list[Frame]:
    """The frames with truth, where its topic covers their stamps."""
    if not truth.stamps:
        return frames
    stamps, poses, _ = truth.in_time()
    return [
        replace(frame, truth=interpolate(stamps, poses, frame.stamp))
        if stamps[0] - 1e-9 <= frame.stamp <= stamps[-1] + 1e-9
        else frame
        for frame in frames
    ]


def _with_commands(frames: list[Frame], commands: list[tuple[float, float, float]]) -> list[Frame]:
    """The frames with the latest command at their stamps, where there is one by then."""
    if not commands:
        return frames
    commands = sorted(commands, key=lambda command: command[0])
    latest = np.searchsorted([stamp for stamp, *_ in commands], [frame.stamp for frame in frames], side="right") - 1
    return [
        replace(frame, command=commands[k][1:]) if k >= 0 else frame
        for frame, k in zip(frames, latest.tolist(), strict=True)
    ]


def _scan(seen: _SeenScan, content: _Content, range_max: float | None) -> Scan:
    message, place = seen.message, seen.place
    ranges = np.asarray(message.ranges, dtype=np.float64)
    first, step = float(message.angle_min), float(message.angle_increment)
    if not (math.isfinite(first) and math.isfinite(step)):
        raise LogError(f"{place}: angles must be finite, got angle_min {first} and angle_increment {step}")
    if not message.range_max > message.range_min >= 0.0:
        raise LogError(f"{place}: expected 0 <= range_min < range_max, got {message.range_min} and {message.range_max}")
    try:
        mount, upside_down = content.transforms.mount(content.odometry.child_frame, message.header.frame_id)
    except ValueError as error:
        raise LogError(f"{place}: {error}") from None
    between_beams = float(message.time_increment)
    beams = np.arange(ranges.size, dtype=np.float64)
    angles = first + step * beams
    return Scan(
        ranges=ranges,
        angles=-angles if upside_down else angles,
        range_min=float(message.range_min),
        range_max=float(message.range_max) if range_max is None else range_max,
        stamp=seen.stamp,
        mount=mount,
        time_offsets=between_beams * beams if between_beams != 0.0 else None,
    )


def _finite(twist: Pose) -> Pose | None:
    return twist if np.all(np.isfinite(twist)) else None
