# SPDX-License-Identifier: MIT
"""Choose the topics of a bag that are read, by their types and names."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

from testbed.formats.checksums import SEAL_TOPIC
from testbed.formats.log import LogError, Topic
from testbed.formats.ros.reading.content import BagContent
from testbed.formats.ros.reading.namespaces import choices, is_within, of_namespace, of_topics
from testbed.formats.ros.reading.raw_scans import ScanRecorder

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ECHO_TYPE = "sensor_msgs/msg/MultiEchoLaserScan"
CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""The second is that of ROS 1 before 2013."""
COMMAND_TYPES = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
MAP_TYPE = "nav_msgs/msg/OccupancyGrid"
DESCRIPTION = "/robot_description"
COMMANDS = "/cmd_vel"
TRUTH_WORDS = ("truth", "mocap", "vicon", "vrpn", "optitrack", "qualisys")
"""A topic whose name contains one of these words holds the true pose."""
TRUTH_TYPES = (
    ODOMETRY_TYPE,
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Path",
)
"""Types of messages that may hold it; the first of which there is one counts."""


def choose_topics(path: Path, reader: Any, content: BagContent) -> list[Any]:
    """Connections that are to be read; what they are for goes into `content`."""
    connections = reader.connections
    if content.selection.topics:
        try:
            connections = of_topics(connections, content.selection.topics)
        except ValueError as error:
            raise LogError(f"{path}: {error}") from None
    if content.selection.namespace is not None:
        connections = of_namespace(connections, content.selection.namespace)
        if not any(is_within(connection.topic, content.selection.namespace) for connection in connections):
            there = choices(connection.topic for connection in reader.connections) or "; leave --namespace out"
            raise LogError(f"{path}: no topic begins with /{content.selection.namespace}/{there}")
    by_type: defaultdict[str, set[str]] = defaultdict(set)
    for connection in connections:
        by_type[connection.msgtype].add(connection.topic)
    poses, maps = sorted(by_type[ODOMETRY_TYPE]), sorted(by_type[MAP_TYPE])
    filled = {c.topic for c in connections if c.msgcount}
    others = [topic for topic in poses if not _is_ground_truth(topic)]
    frames = set().union(*(by_type[kind] for kind in TRANSFORM_TYPES))
    transforms = usual_topic(sorted(topic for topic in frames if "static" not in topic), "/tf")
    if transforms in filled or filled & set(others):
        others = [topic for topic in others if topic in filled]
    truths = [topic for kind in TRUTH_TYPES for topic in sorted(by_type[kind]) if _is_ground_truth(topic)]
    commands = sorted(set().union(*(by_type[kind] for kind in COMMAND_TYPES)))
    by_type[SCAN_TYPE] |= by_type[ECHO_TYPE]
    seen = SCAN_TYPE if content.selection.heights is None else CLOUD_TYPE
    if not by_type[seen] and (content.selection.heights is not None or by_type[CLOUD_TYPE]):
        there = ", ".join(sorted(by_type[SCAN_TYPE if seen == CLOUD_TYPE else CLOUD_TYPE])) or "nothing of either kind"
        advice = "leave --slice out" if seen == CLOUD_TYPE else "--slice LOW,HIGH makes scans of them, heights in m"
        raise LogError(f"{path}: no topic of type {seen}, but {there}; {advice}")
    content.scans = {topic: ScanRecorder(content.scan_store).finish() for topic in sorted(by_type[seen])}
    if not others and by_type[seen] and transforms is not None:
        content.topics = {"odometry": transforms}
    else:
        content.topics = {"odometry": _choose(path, ODOMETRY_TYPE, others, "/odom", reader)}
    if truths:
        content.topics["truth"] = truths[0]
    if COMMANDS in commands or len(commands) == 1:
        content.topics["commands"] = COMMANDS if COMMANDS in commands else commands[0]
    if true_maps := [topic for topic in maps if _is_ground_truth(topic)]:
        content.topics["map"] = true_maps[0]
    taken = {*content.topics.values(), *content.scans, *(by_type["std_msgs/msg/String"] & {DESCRIPTION})}
    wanted = [c for c in connections if c.topic in taken or c.msgtype in TRANSFORM_TYPES]
    content.all_topics = _all_topics(reader, content, {c.topic for c in wanted})
    derived = {SEAL_TOPIC, *(f"{topic}_cloud" for topic in content.scans)}
    content.others = sorted(
        {
            f"{c.topic} ({c.msgtype}, {c.msgcount} messages)"
            for c in reader.connections
            if c not in wanted and c.topic not in derived
        }
    )
    return wanted


def _all_topics(reader: Any, content: BagContent, wanted: set[str]) -> list[Topic]:
    """Every topic of the bag, with what it is read for."""
    uses = {topic: use for use, topic in content.topics.items()} | dict.fromkeys(content.scans, "scans")
    uses |= {DESCRIPTION: "robot", SEAL_TOPIC: "check sum"}
    counts: defaultdict[tuple[str, str], int] = defaultdict(int)
    for connection in reader.connections:
        counts[connection.topic, connection.msgtype] += connection.msgcount
    return [
        Topic(name, kind, count, uses.get(name, "transforms" if name in wanted else ""))
        for (name, kind), count in sorted(counts.items())
    ]


def _is_ground_truth(topic: str) -> bool:
    return any(word in topic.lower() for word in TRUTH_WORDS)


def _choose(path: Path, kind: str, topics: list[str], usual: str, reader: Any) -> str:
    if not topics:
        moving = [c.topic for c in reader.connections if c.msgtype in TRANSFORM_TYPES and "static" not in c.topic]
        there = ", ".join(sorted({f"{c.topic} ({c.msgtype})" for c in reader.connections})[:8]) or "nothing"
        raise LogError(f"{path}: no topic of type {kind}; there is: {there}{choices(moving)}")
    chosen = usual_topic(topics, usual)
    if chosen is None:
        several = f"several topics of type {kind} and none is {usual}: {', '.join(topics)}"
        raise LogError(f"{path}: {several}; --topics NAME says which{choices(topics)}")
    return chosen


def usual_topic(topics: list[str], usual: str) -> str | None:
    """The topic of that name, or the only one, or the only one that ends so, such as /front/scan; else None."""
    ending = [topic for topic in topics if topic.endswith(usual)]
    for candidates in ([topic for topic in topics if topic == usual], topics, ending):
        if len(candidates) == 1:
            return candidates[0]
    return None
