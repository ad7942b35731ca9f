# SPDX-License-Identifier: MIT
"""Messages and files that are packed by zstd."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of what zstd has packed; no message of ROS 2 begins so."""


def zstd() -> Any:
    """The module that packs and unpacks: what rosbags itself reads with."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd


def messages(reader: Any, connections: list[Any]) -> Iterator[tuple[Any, int, bytes]]:
    """Connection, time of the bag [ns] and content of the messages of a bag, in their order.

    Those that were packed one by one are unpacked, also where no metadata.yaml is left to say so.
    """
    if not reader.is2:
        yield from reader.messages(connections=connections)
        return
    unpack = zstd().decompress
    for connection, time, raw in reader.messages(connections=connections):
        yield connection, time, unpack(raw) if raw[:4] == MAGIC else raw
