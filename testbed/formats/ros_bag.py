# SPDX-License-Identifier: MIT
"""ROS bags, read without ROS: rosbag2 directories (MCAP, SQLite), single `.mcap` or `.db3` files, ROS 1 `.bag` files.

Scans are `sensor_msgs/LaserScan`, odometry and truth `nav_msgs/Odometry`; the lidar's mount comes from the static
transforms. Frames by REP 105: the odometry's `child_frame_id` is the robot.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.scan import Scan
from slam.se2 import Pose
from testbed.formats.checksums import verify
from testbed.formats.log import Log, LogError
from testbed.formats.transforms import Transforms, planar_pose
from testbed.frame import Frame

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
TRANSFORM_TYPE = "tf2_msgs/msg/TFMessage"
TRUTH_WORDS = ("ground_truth", "truth", "groundtruth")
"""What a topic with the true pose is called."""
LARGEST_METADATA = 1_000_000
"""Bytes of a metadata.yaml."""
ODOMETRY_REACH = 0.2
"""A scan may lie outside of the odometry's time by this much [s], one period of slow odometry."""


def read_bag(path: Path, *, range_max: float | None = None) -> Log:
    """Read a ROS bag; frames are sorted by the stamps in the messages' headers.

    range_max [m] overrides what the scans say. Topics are chosen by type: of several, `/scan` and `/odom`. Odometry and
    truth are interpolated at the scans' stamps; scans outside of the odometry's time are left out and counted.
    Raises LogError, naming the file and the place, for damaged bags, missing topics, clocks that do not meet, and
    values that make no sense.
    """
    if path.is_dir():
        verify(path)
    content = _Content()
    with _complaints(path, content):
        _read_messages(path, content)
    if not content.scans:
        raise LogError(f"{path}: no scans: the topic {content.topics['scan']} is empty")
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

    def in_time(self) -> tuple[NDArray[np.float64], Pose, Pose]:
        """Stamps (n,), poses (n, 3) and twists (n, 3) sorted by time; of equal stamps the first counts."""
        stamps, rows = np.unique(np.array(self.stamps), return_index=True)
        return stamps, np.array(self.poses)[rows], np.array(self.twists)[rows]


@dataclass
class _Content:
    topics: dict[str, str] = field(default_factory=dict)
    scans: list[tuple[float, str, Any]] = field(default_factory=list)
    odometry: _Track = field(default_factory=_Track)
    truth: _Track = field(default_factory=_Track)
    transforms: Transforms = field(default_factory=Transforms)
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
    if path.is_dir() and metadata.stat().st_size > LARGEST_METADATA:
        raise LogError(f"{metadata}: larger than {LARGEST_METADATA} bytes")
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        content.topics = _choose_topics(path, reader)
        wanted = [c for c in reader.connections if c.topic in content.topics.values() or c.msgtype == TRANSFORM_TYPE]
        for connection, _, raw in reader.messages(connections=wanted):
            content.messages += 1
            if connection.msgtype == TRANSFORM_TYPE and "static" not in connection.topic:
                continue  # moving joints are no mount
            _take(path, content, connection.topic, reader.deserialize(raw, connection.msgtype))


def _choose_topics(path: Path, reader: Any) -> dict[str, str]:
    """Topic of the scans, the odometry and, if there is one, the truth."""
    by_type: defaultdict[str, list[str]] = defaultdict(list)
    for connection in reader.connections:
        by_type[connection.msgtype].append(connection.topic)
    poses = sorted(set(by_type[ODOMETRY_TYPE]))
    truths = [topic for topic in poses if any(word in topic.lower() for word in TRUTH_WORDS)]
    others = [topic for topic in poses if topic not in truths]
    topics = {
        "scan": _choose(path, SCAN_TYPE, sorted(set(by_type[SCAN_TYPE])), "/scan", reader),
        "odometry": _choose(path, ODOMETRY_TYPE, others, "/odom", reader),
    }
    return topics | ({"truth": truths[0]} if truths else {})


def _choose(path: Path, kind: str, topics: list[str], usual: str, reader: Any) -> str:
    if not topics:
        there = ", ".join(sorted({f"{c.topic} ({c.msgtype})" for c in reader.connections})[:8]) or "nothing"
        raise LogError(f"{path}: no topic of type {kind}; there is: {there}")
    if len(topics) > 1 and usual not in topics:
        raise LogError(f"{path}: several topics of type {kind} and none is {usual}: {', '.join(topics)}")
    return usual if usual in topics else topics[0]


def _take(path: Path, content: _Content, topic: str, message: Any) -> None:
    place = f"{path}: message {content.messages} ({topic})"
    if hasattr(message, "transforms"):
        content.transforms.add(message)
        return
    time = message.header.stamp
    stamp = (time.sec * 1_000_000_000 + time.nanosec) / 1_000_000_000  # division of integers: correctly rounded
    if topic == content.topics["scan"]:
        content.scans.append((stamp, place, message))
        return
    track = content.odometry if topic == content.topics["odometry"] else content.truth
    try:
        pose = planar_pose(message.pose.pose.position, message.pose.pose.orientation)
    except ValueError as error:
        raise LogError(f"{place}: {error}") from None
    track.stamps.append(stamp)
    track.poses.append(pose)
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    track.twists.append(np.array([linear.x, linear.y, angular.z]))
    track.child_frame = track.child_frame or message.child_frame_id


def _assemble(path: Path, content: _Content, range_max: float | None) -> Log:
    stamps, poses, twists = content.odometry.in_time()
    frames = [
        Frame(stamp=float(t), odometry=pose, twist=_finite(twist))
        for t, pose, twist in zip(stamps, poses, twists, strict=True)
    ]
    notes = [f"scans from {content.topics['scan']}, odometry from {content.topics['odometry']}"]
    outside = 0
    for stamp, place, message in content.scans:
        if not stamps[0] - ODOMETRY_REACH <= stamp <= stamps[-1] + ODOMETRY_REACH:
            outside += 1
            continue
        at = int(np.clip(np.searchsorted(stamps, stamp), 0, len(stamps) - 1))
        frames.append(
            Frame(
                stamp=stamp,
                odometry=interpolate(stamps, poses, stamp),
                scan=_scan(place, message, content, stamp, range_max),
                twist=_finite(twists[at]),
            )
        )
    if outside == len(content.scans):
        raise LogError(
            f"{path}: the clocks of scans and odometry do not meet: scans from {content.scans[0][0]:.3f} to "
            f"{content.scans[-1][0]:.3f} s, odometry from {stamps[0]:.3f} to {stamps[-1]:.3f} s"
        )
    if outside:
        notes.append(f"{outside} of {len(content.scans)} scans lie outside of the odometry's time and are left out")
    # a scan goes before odometry of the same stamp, which it replaces: the frame tells it already
    with_scan = {frame.stamp for frame in frames if frame.scan is not None}
    frames = [frame for frame in frames if frame.scan is not None or frame.stamp not in with_scan]
    frames.sort(key=lambda frame: frame.stamp)
    return Log(path=path, format="ROS bag", frames=_with_truth(frames, content.truth), notes=tuple(notes))


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


def _with_truth(frames: list[Frame], truth: _Track) -> list[Frame]:
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


def _scan(place: str, message: Any, content: _Content, stamp: float, range_max: float | None) -> Scan:
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
        stamp=stamp,
        mount=mount,
        time_offsets=between_beams * beams if between_beams != 0.0 else None,
    )


def _finite(twist: Pose) -> Pose | None:
    return twist if np.all(np.isfinite(twist)) else None
