# SPDX-License-Identifier: MIT
"""Bags of any messages, written by another program's library."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from slam import se2
from testbed.frame_table import FrameTable

STORE = get_typestore(Stores.ROS2_JAZZY)
TIME = STORE.types["builtin_interfaces/msg/Time"]


def bag(path: Path, messages: list, plugin: StoragePlugin = StoragePlugin.SQLITE3, packed: str | None = None) -> Path:
    """Write messages `(topic, time [ns], message)` as a bag of ROS 2; packed: as FILE, MESSAGE or STORAGE by zstd."""
    writer = Writer(path, version=9, storage_plugin=plugin)
    if packed is not None:
        writer.set_compression(CompressionMode[packed], CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, time, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], time, STORE.serialize_cdr(message, kind))
    return path


def changed(messages: list, topic: str, change) -> list:
    """The messages with those of a topic changed; `change` gets the message and its number."""
    found, number = [], 0
    for name, time, message in messages:
        if name == topic:
            found.append((name, time, change(message, number)))
            number += 1
        else:
            found.append((name, time, message))
    return found


def stamped(message, change):
    """The message with other stamps; `change` makes nanoseconds of nanoseconds."""
    if hasattr(message, "transforms"):
        return replace(message, transforms=[stamped(transform, change) for transform in message.transforms])
    stamp = message.header.stamp
    nanoseconds = change(stamp.sec * 10**9 + stamp.nanosec)
    return replace(message, header=replace(message.header, stamp=TIME(*divmod(nanoseconds, 10**9))))


def at_zero(message, _=0):
    """The message without a stamp."""
    return stamped(message, lambda _: 0)


def set_back(message, seconds: float):
    """The message stamped earlier."""
    return stamped(message, lambda stamp: stamp - round(seconds * 1e9))


def assert_like(read: FrameTable, sound: FrameTable, atol: float = 1e-9) -> None:
    """The same scans at the same stamps and poses."""
    np.testing.assert_allclose(read.stamps[read.scan_rows], sound.stamps[sound.scan_rows], atol=1e-9)
    np.testing.assert_array_equal(read.ranges, sound.ranges)
    gap = se2.between(read.odometry[read.scan_rows], sound.odometry[sound.scan_rows])
    np.testing.assert_allclose(gap, 0.0, atol=atol)
    np.testing.assert_allclose(read.mounts, sound.mounts, atol=1e-9)
