# SPDX-License-Identifier: MIT
"""The three files that a bag can be: MCAP and SQLite for ROS 2, `.bag` for ROS 1. rosbags writes all but the blocks of
messages: names, definitions, quality of service, metadata.yaml, index."""

from __future__ import annotations

import errno
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from testbed.formats.checksums import SEAL_TOPIC, MessageSum
from testbed.formats.ros.layouts import Encoding
from testbed.formats.ros.mcap import MESSAGE_HEAD, McapStorage, message_heads
from testbed.formats.ros.writing.records import Bytes, Framing, Records
from testbed.formats.ros.writing.types import written_types
from testbed.frame_table import Integers

Storage = Literal["mcap", "sqlite", "rosbag1"]
"""mcap, sqlite: a rosbag2 directory; rosbag1: one file."""

LATCHED = ("/tf_static", "/robot_description", "/ground_truth/map")
"""Topics of one message that late subscribers still receive."""
ROSBAG2_VERSION: Literal[9] = 9
"""Version of metadata.yaml."""


class Bag(Framing, Protocol):
    """A bag that is being written."""

    types: Any
    """Message types of rosbags, by name."""

    def put(self, topic: str, time: int, message: Any) -> None:
        """Write one message of rosbags' types; time [ns]."""

    def write(self, records: Records) -> None:
        """Write many messages."""


@contextmanager
def new_bag(path: Path, storage: Storage, *, compressed: bool = False) -> Iterator[Bag]:
    """Write a new bag while the block runs; bags without check sums of their own get a seal as the last message.

    compressed: pack MCAP chunks with zstd, ROS 1 chunks with LZ4
    Raises OSError that names `path` where it cannot be written, the data base included.
    """
    try:
        if storage == "rosbag1":
            bag: _Rosbag1 | _Mcap | _Sqlite = _Rosbag1(path, compressed)
        else:
            bag = _Mcap(path, compressed) if storage == "mcap" else _Sqlite(path)
        with bag.writer:
            yield bag
            bag.seal()
    except sqlite3.Error as error:
        number = errno.ENOSPC if error.sqlite_errorcode == sqlite3.SQLITE_FULL else errno.EIO
        raise OSError(number, f"{os.strerror(number)} ({error})", str(path)) from error


class _Rosbag2:
    """What both kinds of rosbag2 directories share."""

    encoding: Encoding = "cdr"

    def __init__(self, path: Path, storage: Any, plugin: Any, compressed: bool) -> None:
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, Writer

        class BlockWriter(Writer):
            """Writes metadata.yaml, and what else of a bag is no message."""

            STORAGE_PLUGINS = {plugin: storage}  # noqa: RUF012  as in its parent

        self._store = written_types()
        self.types = self._store.types
        self.writer = BlockWriter(path, version=ROSBAG2_VERSION, storage_plugin=plugin)
        if compressed:
            self.writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._connections: dict[str, Any] = {}

    def put(self, topic: str, time: int, message: Any) -> None:
        """Write one message."""
        kind = message.__msgtype__
        raw = bytes(self._store.serialize_cdr(message, kind))
        self.noted(topic, time, raw)
        self.writer.write(self.connection(topic, kind), time, raw)

    def noted(self, topic: str, time: int, raw: bytes) -> None:
        """Take note of a message; nothing here."""

    def seal(self) -> None:
        """Write a last message with the sum over all others; nothing here."""

    def connection(self, topic: str, kind: str) -> Any:
        """The connection of a topic, a new one at its first use."""
        if topic not in self._connections:
            qos = [_latched()] if topic in LATCHED else []
            self._connections[topic] = self.writer.add_connection(
                topic, kind, typestore=self._store, offered_qos_profiles=qos
            )
        return self._connections[topic]

    def count(self, records: Records) -> Integers:
        """Note messages for metadata.yaml; the connection of each, (k,)."""
        ids = np.array([self.connection(*topic).id for topic in records.topics])
        for number, count in zip(ids.tolist(), np.bincount(records.topic, minlength=len(ids)).tolist(), strict=True):
            self.writer.counts[number] += count
        self.writer.min_timestamp = min(self.writer.min_timestamp, int(records.time.min()))
        self.writer.max_timestamp = max(self.writer.max_timestamp, int(records.time.max()))
        connections: Integers = ids[records.topic]
        return connections


class _Mcap(_Rosbag2):
    """A rosbag2 directory with an MCAP file, whose chunks have check sums."""

    size = MESSAGE_HEAD.itemsize

    def __init__(self, path: Path, compressed: bool) -> None:
        from rosbags.rosbag2 import StoragePlugin

        super().__init__(path, McapStorage, StoragePlugin.MCAP, compressed)

    def heads(self, topic: tuple[str, str], times: Integers, sizes: Integers) -> Bytes:
        """The heads of message records."""
        return message_heads(self.connection(*topic).id, times, sizes)

    def write(self, records: Records) -> None:
        """Write a chunk."""
        storage: Any = self.writer.storage
        storage.write_chunk(records.data, self.count(records), records.time, records.start[:-1])


class _Sealed:
    """Sums up all messages of a bag and writes the sum as the last message."""

    def __init__(self) -> None:
        self.total = MessageSum()
        self.last_time = 0

    def add(self, topic: str, time: int, raw: bytes | memoryview) -> None:
        """Take in a message."""
        self.total.add(topic, time, raw)
        self.last_time = max(self.last_time, time)


class _Sqlite(_Rosbag2):
    """A rosbag2 directory with an SQLite data base."""

    size = 0

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

        class BlockStorage(Sqlite3Writer):
            """Keeps no journal, since an unfinished bag is deleted, and makes the index when all rows are there."""

            INDEX = "CREATE INDEX timestamp_idx ON messages (timestamp ASC);"
            SQLITE_SCHEMA = Sqlite3Writer.SQLITE_SCHEMA.replace(INDEX, "")

            def __init__(self, path: Path, compression: Any) -> None:
                super().__init__(path, compression)
                self.conn.execute("PRAGMA journal_mode = OFF")
                self.conn.execute("PRAGMA synchronous = OFF")

            def close(self, version: int, metadata: str) -> None:
                self.cursor.execute(self.INDEX)
                super().close(version, metadata)

        super().__init__(path, BlockStorage, StoragePlugin.SQLITE3, compressed=False)
        self._sum = _Sealed()

    def noted(self, topic: str, time: int, raw: bytes) -> None:
        """Add a message to the sum."""
        self._sum.add(topic, time, raw)

    def heads(self, topic: tuple[str, str], times: Integers, sizes: Integers) -> Bytes:
        """Nothing: a row has a column for each value."""
        self.connection(*topic)
        return np.empty((len(times), 0), dtype=np.uint8)

    def write(self, records: Records) -> None:
        """Write rows."""
        ids: list[int] = self.count(records).tolist()
        storage: Any = self.writer.storage
        raws = list(_messages(records, self._sum, 0))
        rows = zip(ids, records.time.tolist(), raws, strict=True)
        storage.cursor.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES(?, ?, ?)", rows)

    def seal(self) -> None:
        """Write the sum over all messages."""
        text = self.types["std_msgs/msg/String"](data=self._sum.total.text)
        self.put(SEAL_TOPIC, self._sum.last_time, text)


class _Rosbag1:
    """One file for ROS 1."""

    encoding: Encoding = "ros1"
    HEAD = np.dtype(
        [
            ("size", "<u4"), ("op_size", "<u4"), ("op", "S4"), ("conn_size", "<u4"), ("conn", "S5"),
            ("connection", "<u4"), ("time_size", "<u4"), ("time", "S5"), ("sec", "<u4"), ("nanosec", "<u4"),
            ("message_size", "<u4"),
        ]
    )  # fmt: skip
    """Head of a message record (wiki.ros.org/Bags/Format/2.0)."""
    size = HEAD.itemsize

    def __init__(self, path: Path, compressed: bool) -> None:
        from rosbags.rosbag1 import Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self._store = get_typestore(Stores.ROS1_NOETIC)
        self._store.register(
            get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
        )
        self.types = self._store.types
        self.writer = Writer(path)
        if compressed:
            self.writer.set_compression(Writer.CompressionFormat.LZ4)
        self._connections: dict[str, Any] = {}
        self._sum = _Sealed()

    def put(self, topic: str, time: int, message: Any) -> None:
        """Write one message."""
        kind = message.__msgtype__
        raw = bytes(self._store.serialize_ros1(message, kind))
        self._sum.add(topic, time, raw)
        self.writer.write(self._connection(topic, kind), time, raw)

    def heads(self, topic: tuple[str, str], times: Integers, sizes: Integers) -> Bytes:
        """The heads of message records."""
        heads = np.zeros(len(times), dtype=self.HEAD)
        heads["size"] = self.size - 8  # without itself and the size of the message
        heads["op_size"], heads["op"] = 4, b"op=\x02"
        heads["conn_size"], heads["conn"], heads["connection"] = 9, b"conn=", self._connection(*topic).id
        heads["time_size"], heads["time"] = 13, b"time="
        heads["sec"], heads["nanosec"] = np.divmod(times, 1_000_000_000)
        heads["message_size"] = sizes
        return heads.view(np.uint8).reshape(len(times), -1)

    def write(self, records: Records) -> None:
        """Write a chunk."""
        ids = np.array([self._connection(*topic).id for topic in records.topics])[records.topic]
        for _ in _messages(records, self._sum, self.size):
            pass
        chunk = self.writer.chunks[-1]
        before, times = chunk.data.tell(), records.time
        chunk.data.write(records.data)
        for number in np.unique(ids).tolist():
            chosen = ids == number
            places = (before + records.start[:-1][chosen]).tolist()
            chunk.connections[number] += zip(times[chosen].tolist(), places, strict=True)
        chunk.start, chunk.end = min(int(times.min()), chunk.start), max(int(times.max()), chunk.end)
        self.writer.write_chunk(chunk)

    def seal(self) -> None:
        """Write the sum over all messages."""
        text = self.types["std_msgs/msg/String"](data=self._sum.total.text)
        self.put(SEAL_TOPIC, self._sum.last_time, text)

    def _connection(self, topic: str, kind: str) -> Any:
        if topic not in self._connections:
            latching = int(topic in LATCHED)
            connection = self.writer.add_connection(topic, kind, typestore=self._store, latching=latching)
            self._connections[topic] = connection
        return self._connections[topic]


def _messages(records: Records, total: _Sealed, head: int) -> Iterator[memoryview]:
    """The messages of records without their heads; each is added to the sum."""
    data, names = memoryview(records.data), [name for name, _ in records.topics]
    starts = records.start.tolist()
    for topic, time, begin, end in zip(
        records.topic.tolist(), records.time.tolist(), starts[:-1], starts[1:], strict=True
    ):
        raw = data[begin + head : end]
        total.add(names[topic], time, raw)
        yield raw


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
