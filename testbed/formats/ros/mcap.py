# SPDX-License-Identifier: MIT
"""MCAP files: written a chunk at a time with check sums, and their summary verified before reading.

The writers at hand (rosbags, mcap) take one message at a time; here a chunk with all its messages is one buffer.
Source: the MCAP format specification, https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.formats.log import LogError
from testbed.formats.ros.packing import zstd
from testbed.frame_table import Integers

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import CompressionMode

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07
CHUNK_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = 0x08, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F
"""Kinds of records."""

RECORD = struct.Struct("<BQ")
"""Kind and size, in front of each record."""
FOOTER_CONTENT = struct.Struct("<QQI")
"""Begin of the summary, begin of its offsets, check sum of the summary and of the footer up to here."""
MESSAGE_HEAD = np.dtype(
    [("kind", "u1"), ("size", "<u8"), ("channel", "<u2"), ("sequence", "<u4"), ("logged", "<u8"), ("published", "<u8")]
)
"""A message record up to the message itself."""
_END = RECORD.size + FOOTER_CONTENT.size + len(MAGIC)
"""Bytes of the footer and the mark behind it."""
ZSTD_LEVEL = 3
"""The default of zstd, and of rosbag2."""


class _Chunk(NamedTuple):
    """What the summary says of a chunk."""

    start: int
    """First byte in the file."""
    size: int
    indices: list[tuple[int, int]]
    """Channel, and first byte of its index in the file."""
    index_size: int
    packed: int
    """Bytes of the records as they are in the file."""
    whole: int
    """Bytes of the records, unpacked."""
    first_time: int
    last_time: int
    """[ns]"""


class McapStorage:
    """A storage that `rosbags.rosbag2.Writer` drives, with `write_chunk` for many messages at once."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        self.path = path / f"{path.name}.mcap"
        self._zstd = compression.name == "STORAGE"
        self._file = self.path.open("xb")
        self._file.write(MAGIC + _record(HEADER, _text("ros2") + _text(f"rosbags-{version('rosbags')}")))
        self._schemas: dict[str, tuple[int, bytes]] = {}
        self._channels: list[bytes] = []
        self._counts: dict[int, int] = {}
        self._chunks: list[_Chunk] = []
        self._pending = bytearray()
        self._pending_index: list[tuple[int, int, int]] = []

    def add_msgtype(self, connection: Connection) -> None:
        """Add the schema of a connection."""
        encoding = "ros2msg" if connection.msgdef.format.name == "MSG" else "ros2idl"
        number = len(self._schemas) + 1
        content = _text(connection.msgtype) + _text(encoding) + _text(connection.msgdef.data)
        self._schemas[connection.msgtype] = number, _record(SCHEMA, struct.pack("<H", number) + content)
        self._pending += self._schemas[connection.msgtype][1]

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Add a channel."""
        extra: Any = connection.ext
        metadata = _text("offered_qos_profiles") + _text(offered_qos_profiles)
        content = struct.pack("<HH", connection.id, self._schemas[connection.msgtype][0]) + _text(connection.topic)
        content += _text(extra.serialization_format) + struct.pack("<I", len(metadata)) + metadata
        self._channels.append(_record(CHANNEL, content))
        self._counts[connection.id] = 0
        self._pending += self._channels[-1]

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Write one message, into the next chunk."""
        head = message_heads(connection.id, np.array([timestamp]), np.array([len(data)]))
        self._pending_index.append((connection.id, timestamp, len(self._pending)))
        self._pending += head.tobytes() + bytes(data)

    def write_chunk(self, data: bytes, channels: Integers, times: Integers, starts: Integers) -> None:
        """Write records that are ready; channel, time [ns] and first byte in `data` of each, (k,)."""
        early = np.array(self._pending_index, dtype=np.int64).reshape(-1, 3)
        channels, times = np.concatenate([early[:, 0], channels]), np.concatenate([early[:, 1], times])
        starts = np.concatenate([early[:, 2], starts + len(self._pending)])
        whole = bytes(self._pending) + data
        self._pending, self._pending_index = bytearray(), []
        packed = zstd().compress(whole, ZSTD_LEVEL) if self._zstd else whole
        first, last = (int(times.min()), int(times.max())) if times.size else (0, 0)
        head = struct.pack("<QQQI", first, last, len(whole), zlib.crc32(whole))
        head += _text("zstd" if self._zstd else "") + struct.pack("<Q", len(packed))
        begin = self._file.tell()
        self._file.write(RECORD.pack(CHUNK, len(head) + len(packed)) + head)
        self._file.write(packed)
        end = self._file.tell()
        indices = []
        for channel in np.unique(channels).tolist():
            chosen = channels == channel
            entries = np.stack([times[chosen], starts[chosen]], axis=1).astype("<u8").tobytes()
            indices.append((channel, self._file.tell()))
            self._file.write(_record(MESSAGE_INDEX, struct.pack("<HI", channel, len(entries)) + entries))
            self._counts[channel] += int(chosen.sum())
        size = self._file.tell() - end
        self._chunks.append(_Chunk(begin, end - begin, indices, size, len(packed), len(whole), first, last))

    def close(self, version: int, metadata: str) -> None:
        """Write what is left, the metadata, the summary and the footer."""
        _ = version
        if self._pending:
            self.write_chunk(b"", *np.empty((3, 0), dtype=np.int64))
        metadata_start = self._file.tell()
        entry = _text("serialized_metadata") + _text(metadata)
        content = _record(METADATA, _text("rosbag2") + struct.pack("<I", len(entry)) + entry)
        self._file.write(content + _record(DATA_END, bytes(4)))
        metadata_place, summary_start = (metadata_start, len(content)), self._file.tell()
        groups = [
            (SCHEMA, b"".join(record for _, record in self._schemas.values())),
            (CHANNEL, b"".join(self._channels)),
            (CHUNK_INDEX, b"".join(map(_chunk_index, self._chunks))),
            (METADATA_INDEX, _record(METADATA_INDEX, struct.pack("<QQ", *metadata_place) + _text("rosbag2"))),
            (STATISTICS, self._statistics()),
        ]
        summary, offsets = b"", b""
        for kind, records in groups:
            at = summary_start + len(summary)
            offsets += _record(SUMMARY_OFFSET, struct.pack("<BQQ", kind, at, len(records))) if records else b""
            summary += records
        offsets_start = summary_start + len(summary)
        summary += offsets + RECORD.pack(FOOTER, FOOTER_CONTENT.size) + struct.pack("<QQ", summary_start, offsets_start)
        self._file.write(summary + struct.pack("<I", zlib.crc32(summary)) + MAGIC)
        self._file.close()

    def abort(self) -> None:
        """Close the file as it is."""
        self._file.close()

    def _statistics(self) -> bytes:
        used = [chunk for chunk in self._chunks if chunk.indices]
        first = min((chunk.first_time for chunk in used), default=0)
        last = max((chunk.last_time for chunk in used), default=0)
        sizes = len(self._schemas), len(self._channels), 0, 1, len(self._chunks)
        content = struct.pack("<QHIIIIQQ", sum(self._counts.values()), *sizes, first, last)
        counts = b"".join(struct.pack("<HQ", *item) for item in sorted(self._counts.items()))
        return _record(STATISTICS, content + struct.pack("<I", len(counts)) + counts)


def message_heads(channel: int, times: Integers, sizes: Integers) -> NDArray[np.uint8]:
    """The heads of message records, (k, bytes); times [ns], sizes [bytes] of the messages (k,)."""
    heads = np.zeros(len(times), dtype=MESSAGE_HEAD)
    heads["kind"], heads["channel"] = MESSAGE, channel
    heads["size"] = sizes + (MESSAGE_HEAD.itemsize - RECORD.size)
    heads["logged"] = heads["published"] = times
    return heads.view(np.uint8).reshape(len(times), -1)


def verify_mcap(path: Path) -> None:
    """Compare the summary of an MCAP file with its check sum, where it has one.

    Raises LogError, naming the file and the place, where they differ or the file has no proper end.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - _END, 0))
        end = file.read()
        if size < _END or not end.endswith(MAGIC) or RECORD.unpack_from(end) != (FOOTER, FOOTER_CONTENT.size):
            raise LogError(f"{path}: damaged MCAP file: ends at byte {size} without its footer: was it cut off?")
        summary_start, _, crc = FOOTER_CONTENT.unpack_from(end, RECORD.size)
        if crc == 0:
            return
        checked_end = size - len(MAGIC) - 4
        if summary_start > checked_end:
            raise LogError(f"{path}: damaged MCAP file: the summary begins at byte {summary_start} of {size}")
        file.seek(summary_start)
        if zlib.crc32(file.read(checked_end - summary_start)) != crc:
            raise LogError(f"{path}: damaged MCAP file: bytes {summary_start} to {size} differ from their check sum")


def _record(kind: int, content: bytes) -> bytes:
    return RECORD.pack(kind, len(content)) + content


def _text(text: str) -> bytes:
    content = text.encode()
    return struct.pack("<I", len(content)) + content


def _chunk_index(chunk: _Chunk) -> bytes:
    content = struct.pack("<QQQQ", chunk.first_time, chunk.last_time, chunk.start, chunk.size)
    offsets = b"".join(struct.pack("<HQ", *item) for item in chunk.indices)
    content += struct.pack("<I", len(offsets)) + offsets + struct.pack("<Q", chunk.index_size)
    content += _text("" if chunk.packed == chunk.whole else "zstd") + struct.pack("<QQ", chunk.packed, chunk.whole)
    return _record(CHUNK_INDEX, content)
