# SPDX-License-Identifier: MIT
"""Blocks of frames as the bytes of ROS messages, in the order of the bag, for all storages alike.

The messages that every frame has (odometry, transforms, commands, truth) stand next to each other in a bag. Together
they have a fixed layout, so that those of a whole block are one numpy record array. Scans and point clouds are put in
between as slices of their arrays.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from slam import se2
from testbed.formats.beams import even_spacing
from testbed.formats.log import LogError
from testbed.formats.ros import layouts
from testbed.formats.ros.layouts import CLOUD_END, SCAN_END, Encoding, Part
from testbed.frame_table import BeamPattern, Floats, FrameTable, Integers

Bytes = NDArray[np.uint8]

TYPES = {
    "odometry": "nav_msgs/msg/Odometry",
    "transform": "tf2_msgs/msg/TFMessage",
    "twist": "geometry_msgs/msg/Twist",
    "scan": "sensor_msgs/msg/LaserScan",
    "cloud": "sensor_msgs/msg/PointCloud2",
}


class Topic(NamedTuple):
    """A topic with a message for every frame."""

    name: str
    type: str
    parts: list[Part]


ODOMETRY = Topic("/odom", TYPES["odometry"], layouts.odometry("odom", "base_link"))
TRANSFORM = Topic("/tf", TYPES["transform"], layouts.transform("odom", "base_link"))
COMMAND = Topic("/cmd_vel", TYPES["twist"], layouts.twist())
TRUTH = Topic("/ground_truth/odom", TYPES["odometry"], layouts.odometry("map", "base_link"))
TRUE_TRANSFORM = Topic("/ground_truth/tf", TYPES["transform"], layouts.transform("map", "odom"))


@dataclass(frozen=True, eq=False)
class Records:
    """Consecutive messages of a bag."""

    data: bytes
    """All records, each the storage's own head and a message."""
    topics: list[tuple[str, str]]
    """Name and type of the topics."""
    topic: Integers
    """Topic of each message, as an index into `topics`, (k,)."""
    time: Integers
    """Time of each message [ns], (k,)."""
    start: Integers
    """Where each record begins in `data`, and the end, (k + 1,)."""


class Framing(Protocol):
    """The head that a storage puts in front of each message."""

    size: int
    """Bytes."""
    encoding: Encoding

    def heads(self, topic: tuple[str, str], times: Integers, sizes: Integers) -> Bytes:
        """Make heads of messages of a topic, (k, size); times [ns] (k,), sizes [bytes] (k,)."""


@dataclass(eq=False)
class RecordMaker:
    """Makes the records of blocks of frames."""

    framing: Framing
    scan_topics: dict[str, str]
    """Topic of each lidar's scans, by the lidar's name."""
    scan_times: dict[str, float]
    """Time between two scans of each lidar [s]; 0 = unknown."""
    cloud: bool
    """Whether each scan also becomes a point cloud."""
    _layouts: dict[str, NDArray[Any]] = field(default_factory=dict)
    _spacings: dict[int, tuple[BeamPattern, Floats | None]] = field(default_factory=dict)

    def records(self, block: FrameTable) -> Iterator[Records]:
        """The records of a block, in one piece unless commands or truth begin or end within it.

        Raises LogError, with the number of the frame, where the beams of a scan are not evenly spaced.
        """
        self._spacings.clear()
        kinds = np.stack([block.known(block.command), block.known(block.truth)], axis=1)
        borders = (np.flatnonzero(np.any(kinds[1:] != kinds[:-1], axis=1)) + 1).tolist()
        for begin, end in pairwise([0, *borders, len(block)]):
            yield self._alike(block.rows(begin, end), *kinds[begin].tolist())

    def _alike(self, block: FrameTable, has_command: bool, has_truth: bool) -> Records:
        """The records of frames that all have, or all lack, commands and truth."""
        times = nanoseconds(block.stamps)
        topics = [ODOMETRY, TRANSFORM, *([COMMAND] if has_command else ())]
        topics += [TRUTH, TRUE_TRANSFORM] if has_truth else []
        columns = [self._column(topic, block, times) for topic in topics]
        every = np.ascontiguousarray(np.concatenate(columns, axis=1))
        scans = self._scans(block, times)
        pieces, at, width = [], 0, every.shape[1]
        rows = every.reshape(-1).data
        for number, row in enumerate(block.scan_rows.tolist()):
            pieces.append(rows[at : (row + 1) * width])
            at = (row + 1) * width
            pieces += scans.pieces[number]
        pieces.append(rows[at:])
        names = [(topic.name, topic.type) for topic in topics]
        n, sizes = len(block), [column.shape[1] for column in columns]
        row = np.concatenate([np.repeat(np.arange(n), len(topics)), scans.row])
        order = np.argsort(row, kind="stable")  # within a frame: its fixed messages, then its scan, then the cloud
        topic = np.concatenate([np.tile(np.arange(len(topics)), n), len(topics) + scans.topic])
        lengths = np.concatenate([np.tile(sizes, n), scans.size])[order]
        return Records(
            data=b"".join(pieces),
            topics=[*names, *scans.topics],
            topic=topic[order],
            time=times[row[order]],
            start=np.concatenate([[0], np.cumsum(lengths)]),
        )

    def _column(self, topic: Topic, block: FrameTable, times: Integers) -> Bytes:
        """The records of a topic with a message for every frame, (n, bytes)."""
        messages = np.repeat(self._layout(topic.name, topic.parts), len(block))
        if topic is COMMAND:
            messages["linear"][:, 0], messages["angular"][:, 2] = block.command.T
        else:
            _stamp(messages, times)
        if topic is ODOMETRY:
            _place(messages, block.odometry)
            _move(messages, block.twist)
        elif topic is TRANSFORM:
            _place(messages, block.odometry)
        elif topic is TRUTH:
            _place(messages, block.truth)
            _move(messages, np.full((len(block), 3), np.nan))  # unknown
        elif topic is TRUE_TRANSFORM:
            _place(messages, se2.compose(block.truth, se2.inverse(block.odometry)))
        return self._headed((topic.name, topic.type), times, messages, 0)

    def _scans(self, block: FrameTable, times: Integers) -> _ScanMessages:
        """The messages of all scans: their ranges and, where asked for, their points."""
        topics: dict[tuple[str, str], int] = {}
        pieces: list[list[Any]] = [[] for _ in block.scan_rows]
        each = 2 if self.cloud else 1
        topic, size = np.zeros((2, len(block.scan_rows), each), dtype=np.int64)
        ranges = block.ranges.astype("<f4").view(np.uint8).data
        begins = (4 * block.scan_starts).tolist()
        points = _points(block) if self.cloud else None
        for lidar, name in enumerate(block.lidars):
            numbers = np.flatnonzero(block.scan_lidars == lidar)
            if not numbers.size:
                continue
            kinds = [(self.scan_topics[name], TYPES["scan"]), (f"{self.scan_topics[name]}_cloud", TYPES["cloud"])]
            head = self._scan_heads(block, times, numbers, name, kinds[0])
            size[numbers, 0] = head.shape[1] + 4 * block.readings[numbers] + len(SCAN_END)
            topic[numbers, 0] = topics.setdefault(kinds[0], len(topics))
            if points is not None:
                cloud = self._cloud_heads(block, times, numbers, name, kinds[1], points)
                size[numbers, 1] = cloud.shape[1] + points.size[numbers] + len(CLOUD_END)
                topic[numbers, 1] = topics.setdefault(kinds[1], len(topics))
            for k, number in enumerate(numbers.tolist()):
                pieces[number] = [head[k], ranges[begins[number] : begins[number + 1]], SCAN_END]
                if points is not None:
                    pieces[number] += [cloud[k], points.of(number), CLOUD_END]
        rows = np.repeat(block.scan_rows, each)
        return _ScanMessages(pieces, list(topics), rows, topic.reshape(-1), size.reshape(-1))

    def _scan_heads(
        self, block: FrameTable, times: Integers, numbers: Integers, lidar: str, topic: tuple[str, str]
    ) -> Bytes:
        """The records of scans of one lidar up to their ranges, (scans, bytes)."""
        messages = np.repeat(self._layout(f"scan of {lidar}", layouts.scan_begin(lidar)), len(numbers))
        _stamp(messages, times[block.scan_rows[numbers]])
        messages["readings"] = block.readings[numbers]
        messages["numbers"][:, :4] = [self._spacing(block, number) for number in numbers.tolist()]
        messages["numbers"][:, 4] = self.scan_times[lidar]
        messages["numbers"][:, 5:] = block.range_limits[numbers]
        rest = 4 * block.readings[numbers] + len(SCAN_END)
        return self._headed(topic, times[block.scan_rows[numbers]], messages, rest)

    def _cloud_heads(
        self, block: FrameTable, times: Integers, numbers: Integers, lidar: str, topic: tuple[str, str], points: _Points
    ) -> Bytes:
        """The records of point clouds of one lidar up to their points, (scans, bytes)."""
        messages = np.repeat(self._layout(f"cloud of {lidar}", layouts.cloud_begin(lidar)), len(numbers))
        _stamp(messages, times[block.scan_rows[numbers]])
        size = points.size[numbers]
        messages["points"], messages["row_step"], messages["bytes"] = size // POINT_BYTES, size, size
        return self._headed(topic, times[block.scan_rows[numbers]], messages, size + len(CLOUD_END))

    def _headed(self, topic: tuple[str, str], times: Integers, messages: NDArray[Any], rest: Integers | int) -> Bytes:
        """Messages, or their beginnings, behind the storage's heads, (k, bytes); rest: bytes that follow, (k,)."""
        content = messages.view(np.uint8).reshape(len(messages), -1)
        sizes = np.broadcast_to(content.shape[1] + np.asarray(rest), len(messages))
        return np.concatenate([self.framing.heads(topic, times, sizes), content], axis=1)

    def _spacing(self, block: FrameTable, number: int) -> Floats:
        """angle_min, angle_max, angle_increment and time_increment of a scan, (4,)."""
        pattern = block.patterns[block.scan_patterns[number]]
        if id(pattern) not in self._spacings:
            self._spacings[id(pattern)] = pattern, _spacing(pattern)  # keeps it, so that its id stays its own
        spacing = self._spacings[id(pattern)][1]
        if spacing is None:
            frame = block.first + int(block.scan_rows[number])
            raise LogError(f"frame {frame}: LaserScan needs beams evenly spaced in angle and time, these are not")
        return spacing

    def _layout(self, name: str, parts: list[Part]) -> NDArray[Any]:
        if name not in self._layouts:
            self._layouts[name] = layouts.message_layout(parts, self.framing.encoding)
        return self._layouts[name]


class _ScanMessages(NamedTuple):
    """The messages of the scans of a block, in the order of the bag."""

    pieces: list[list[Any]]
    """Bytes of each scan's messages, in pieces."""
    topics: list[tuple[str, str]]
    row: Integers
    """Frame of each message, (k,)."""
    topic: Integers
    """Topic of each message, as an index into `topics`, (k,)."""
    size: Integers
    """Bytes of each message, (k,)."""


POINT_BYTES = 12
"""float32 x, y, z."""


class _Points(NamedTuple):
    """The hits of all scans of a block."""

    data: memoryview
    size: Integers
    """Bytes of each scan's points, (m,)."""
    end: list[int]
    """Where the points of each scan end in `data`, with a zero in front, (m + 1,)."""

    def of(self, number: int) -> memoryview:
        """The points of one scan."""
        return self.data[self.end[number] : self.end[number + 1]]


def _points(block: FrameTable) -> _Points:
    """The hits of a block's scans in the frames of their lidars, float32 x, y, z."""
    ranges, limits = np.asarray(block.ranges, dtype=np.float64), np.repeat(block.range_limits, block.readings, axis=0)
    hit = (ranges >= limits[:, 0]) & (ranges > 0.0) & (ranges < limits[:, 1])
    directions = [
        np.stack([np.cos(pattern.angles), np.sin(pattern.angles), np.zeros(pattern.angles.size)], axis=1)
        for pattern in block.patterns
    ]
    of_scans = [directions[k] for k in block.scan_patterns.tolist()]
    every = np.concatenate(of_scans) if of_scans else np.empty((0, 3))
    points = (ranges[hit, None] * every[hit]).astype("<f4")
    hits = np.concatenate([[0], np.cumsum(hit)])[block.scan_starts]
    data = points.view(np.uint8).reshape(-1).data
    return _Points(data, POINT_BYTES * np.diff(hits), (POINT_BYTES * hits).tolist())


def _spacing(pattern: BeamPattern) -> Floats | None:
    """angle_min, angle_max, angle_increment, time_increment (4,); None where the beams are not evenly spaced."""
    count = pattern.angles.size
    times = pattern.time_offsets if pattern.time_offsets is not None else np.zeros(count)
    angles, beats = even_spacing(pattern.angles), even_spacing(times)
    if angles is None or beats is None or abs(beats[0]) > MAX_FIRST_OFFSET:
        return None
    return np.array([angles[0], angles[0] + angles[1] * max(count - 1, 0), angles[1], beats[1]])


MAX_FIRST_OFFSET = 1e-9
"""Largest time of a scan's first beam after its stamp that counts as none [s]."""


def nanoseconds(stamps: Floats) -> Integers:
    """Times in whole nanoseconds; `stamps * 1e9` would lose digits."""
    seconds = np.floor(stamps)
    return seconds.astype(np.int64) * 1_000_000_000 + np.rint((stamps - seconds) * 1e9).astype(np.int64)


def _stamp(messages: NDArray[Any], times: Integers) -> None:
    messages["sec"], messages["nanosec"] = np.divmod(times, 1_000_000_000)


def _place(messages: NDArray[Any], poses: Floats) -> None:
    """Set position and orientation to poses in the plane (n, 3)."""
    messages["position"][:, :2] = poses[:, :2]
    half = (poses[:, 2] / 2.0).tolist()
    # The sine of numpy depends on the processor in its last digit; that of the C library does not.
    messages["orientation"][:, 2] = list(map(math.sin, half))
    messages["orientation"][:, 3] = list(map(math.cos, half))


def _move(messages: NDArray[Any], twists: Floats) -> None:
    """Set the velocities to twists in the plane (n, 3)."""
    messages["linear"][:, :2] = twists[:, :2]
    messages["angular"][:, 2] = twists[:, 2]
