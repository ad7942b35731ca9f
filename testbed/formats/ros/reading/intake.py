# SPDX-License-Identifier: MIT
"""Takes in the messages of a bag one by one, each where its topic belongs; what they say fills a `BagContent`."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slam.occupancy import OccupancyGrid
from testbed.formats.log import LogError
from testbed.formats.ros.layouts import Encoding
from testbed.formats.ros.reading.clocks import first_pass, in_one_pass, one_clock, true_path
from testbed.formats.ros.reading.content import BagContent, RawMessage
from testbed.formats.ros.reading.decode import BadMessageError, Deserialise, RawScan, decode_echoes, decode_scan
from testbed.formats.ros.reading.raw_scans import ScanRecorder
from testbed.formats.ros.reading.topics import DESCRIPTION, ECHO_TYPE, ODOMETRY_TYPE, TRANSFORM_TYPES
from testbed.formats.ros.reading.tracks import CommandColumns, OdometryColumns, PoseColumns
from testbed.formats.ros.reading.transforms import planar_pose

MAX_CELLS = 100_000_000
"""Cells."""


class Intake:
    """The topics of a bag that are read, but clouds and moving transforms."""

    def __init__(self, content: BagContent, reader: Any) -> None:
        self._content, self._reader = content, reader
        self._encoding: Encoding = "cdr" if reader.is2 else "ros1"
        self._scans: dict[str, _Scans] = {}
        self._others: dict[str, _Topic] = {}

    def take(self, connection: Any, message: RawMessage) -> None:
        """Take in a message."""
        topic = connection.topic
        if topic in self._content.scans:
            if topic not in self._scans:
                self._scans[topic] = _Scans(self._content, topic)
            self._scans[topic].take(self._scan(connection, message.data), message)
            return
        if topic not in self._others:
            self._others[topic] = self._topic(connection)
        self._others[topic].take(message)

    def finish(self, path: Path) -> None:
        """Fill the content; LogError, naming the bag, the message and its topic, where one makes no sense."""
        odometry = self._content.topics["odometry"]  # first, since its clock mends others
        for topic in sorted(self._others, key=lambda topic: topic != odometry):
            try:
                self._others[topic].finish()
            except BadMessageError as error:
                raise LogError(f"{path}: message {error.number} ({topic}): {error}") from None
        for topic, scans in self._scans.items():
            self._content.scans[topic] = in_one_pass(self._content, scans.times, scans.recorder.finish())

    def _scan(self, connection: Any, raw: bytes) -> RawScan:
        deserialise = self._deserialise_of(connection)
        return (
            decode_echoes(raw, deserialise)
            if connection.msgtype == ECHO_TYPE
            else decode_scan(raw, self._encoding, deserialise)
        )

    def _deserialise_of(self, connection: Any) -> Deserialise:
        return lambda raw: self._reader.deserialize(raw, connection.msgtype)

    def _topic(self, connection: Any) -> _Topic:
        """Where the messages of a topic without scans belong."""
        content, topic, topics = self._content, connection.topic, self._content.topics
        deserialise = self._deserialise_of(connection)
        if connection.msgtype in TRANSFORM_TYPES:
            return _of_static_transforms(content, deserialise)
        if topic == DESCRIPTION:
            return _of_last(lambda raw: setattr(content, "robot_urdf", deserialise(raw).data))
        if topic == topics.get("map"):
            return _of_last(lambda raw: setattr(content, "truth_map", _grid(deserialise(raw))))
        if topic == topics.get("commands"):
            commands = CommandColumns(self._encoding, deserialise)
            return _Topic(commands.take, lambda: setattr(content, "commands", commands.finish()))
        if connection.msgtype == ODOMETRY_TYPE:
            return _of_odometry(content, topic, OdometryColumns(self._encoding, deserialise))
        return _of_true_poses(content, topic, PoseColumns(connection.msgtype, deserialise))


class _Scans:
    """The scans of one topic."""

    def __init__(self, content: BagContent, topic: str) -> None:
        self.recorder = ScanRecorder(content.scan_store)
        self.times = array("q")
        """Times of the bag [ns]."""
        self._source = f"message {{}} ({topic})"

    def take(self, scan: RawScan, message: RawMessage) -> None:
        self.times.append(message.time)
        self.recorder.take(scan, message.number, self._source)


class _Topic(NamedTuple):
    """What becomes of the messages of a topic."""

    take: Callable[[RawMessage], None]
    finish: Callable[[], None]
    """Raises BadMessageError, with the number of the message in the bag."""


def _of_static_transforms(content: BagContent, deserialise: Deserialise) -> _Topic:
    faults: list[BadMessageError] = []

    def take(message: RawMessage) -> None:
        try:
            content.transforms.add(deserialise(message.data))
        except ValueError as error:
            faults.append(BadMessageError(message.number, str(error)))

    def finish() -> None:
        if faults:
            raise faults[0]

    return _Topic(take, finish)


def _of_last(use: Callable[[bytes], None]) -> _Topic:
    """Of some topics the last message counts."""
    last: list[RawMessage] = []

    def take(message: RawMessage) -> None:
        last[:] = [message]

    def finish() -> None:
        try:
            use(last[0].data)
        except ValueError as error:
            raise BadMessageError(last[0].number, str(error)) from None

    return _Topic(take, finish)


def _of_odometry(content: BagContent, topic: str, columns: OdometryColumns) -> _Topic:
    def finish() -> None:
        times, track = columns.finish(content.notes.append, topic)
        if topic == content.topics["odometry"]:
            content.odometry = one_clock(content, times, track)
        else:
            content.truth = true_path(content, times, track)

    return _Topic(columns.take, finish)


def _of_true_poses(content: BagContent, topic: str, columns: PoseColumns) -> _Topic:
    """Poses of another kind than Odometry are left out, with a note, where they are none in the plane: they may be of a
    camera."""

    def finish() -> None:
        try:
            times, truth = columns.finish(content.notes.append, topic)
        except BadMessageError as error:
            content.notes.append(f"{topic} is not used as truth: pose {error.number + 1}: {error}")
            return
        if len(truth.stamps) > 1 and float(np.ptp(truth.stamps)) == 0.0:
            content.notes.append(f"{topic} is not used as truth: all poses have the stamp {truth.stamps[0]:g} s")
        elif times is None:
            content.truth = truth.first(first_pass(truth.stamps))
        else:
            content.truth = true_path(content, times, truth)

    return _Topic(columns.take, finish)


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
