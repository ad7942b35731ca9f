# SPDX-License-Identifier: MIT
"""Byte layouts of ROS messages as numpy record types, so that many messages are filled in at once.

Between its variable parts (the readings of a scan, the points of a cloud) a message whose texts are fixed has a fixed
layout. Sources: CDR as OMG DDSI-RTPS 2.3, section 10, which ROS 2 uses (little-endian, values aligned to their size
behind a header of four bytes), and the packed serialisation of ROS 1 (wiki.ros.org/msg).
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Encoding = Literal["cdr", "ros1"]

CDR_HEADER = b"\x00\x01\x00\x00"
"""Little-endian CDR."""
FLOAT32 = 7
"""sensor_msgs/PointField.FLOAT32."""


class Field(NamedTuple):
    """A value, or several of one type, in a message."""

    kind: str
    """Type of the value as numpy writes it, such as `<f8`."""
    name: str = ""
    """Name of a value that differs between messages."""
    value: int = 0
    """The value of one without a name, in all messages."""
    number: int = 1
    """How many values there are."""


Part = Field | str
"""A value, or a text that is the same in all messages."""


def header(frame_id: str) -> list[Part]:
    """A std_msgs/Header; ROS 1 has a counter in it, see `message_layout`."""
    return [Field("<u4", "seq"), Field("<i4", "sec"), Field("<u4", "nanosec"), frame_id]


def odometry(frame_id: str, child_frame_id: str) -> list[Part]:
    """A nav_msgs/Odometry."""
    return [
        *header(frame_id),
        child_frame_id,
        Field("<f8", "position", number=3),
        Field("<f8", "orientation", number=4),
        Field("<f8", number=36),
        Field("<f8", "linear", number=3),
        Field("<f8", "angular", number=3),
        Field("<f8", number=36),
    ]


def transform(frame_id: str, child_frame_id: str) -> list[Part]:
    """A tf2_msgs/TFMessage with one transform."""
    translation, rotation = Field("<f8", "position", number=3), Field("<f8", "orientation", number=4)
    return [Field("<u4", value=1), *header(frame_id), child_frame_id, translation, rotation]


def twist() -> list[Part]:
    """A geometry_msgs/Twist."""
    return [Field("<f8", "linear", number=3), Field("<f8", "angular", number=3)]


def scan_begin(frame_id: str) -> list[Part]:
    """A sensor_msgs/LaserScan up to its ranges; `numbers` are its seven values, from angle_min to range_max."""
    return [*header(frame_id), Field("<f4", "numbers", number=7), Field("<u4", "readings")]


def cloud_begin(frame_id: str) -> list[Part]:
    """A sensor_msgs/PointCloud2 of float32 x, y, z up to its points."""
    fields: list[Part] = []
    for k, name in enumerate("xyz"):
        fields += [name, Field("<u4", value=4 * k), Field("u1", value=FLOAT32), Field("<u4", value=1)]
    size = [Field("<u4", value=1), Field("<u4", "points")]
    rest = [Field("u1", value=0), Field("<u4", value=12), Field("<u4", "row_step"), Field("<u4", "bytes")]
    return [*header(frame_id), *size, Field("<u4", value=3), *fields, *rest]


SCAN_END = bytes(4)
"""What follows the ranges: no intensities."""
CLOUD_END = b"\x01"
"""What follows the points: all of them are finite."""


def message_layout(parts: list[Part], encoding: Encoding) -> NDArray[Any]:
    """One message as a record array (1,): its named fields are zero, all else is filled in."""
    cdr = encoding == "cdr"
    at = len(CDR_HEADER) if cdr else 0
    names: list[str] = []
    formats: list[Any] = []
    offsets: list[int] = []
    constants: list[Any] = []
    for part in _values(parts, cdr):
        kind, name, value, count = part
        size = np.dtype(kind).itemsize
        if cdr and not kind.startswith("S"):
            at += -(at - len(CDR_HEADER)) % size
        names.append(name or f"_{len(names)}")
        formats.append((kind, (count,)) if count > 1 else kind)
        offsets.append(at)
        constants.append(value)
        at += size * count
    layout = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": at})
    message = np.zeros(1, dtype=layout)
    for name, constant in zip(names, constants, strict=True):
        message[name] = constant
    if cdr:
        message.view(np.uint8)[: len(CDR_HEADER)] = np.frombuffer(CDR_HEADER, np.uint8)
    return message


def _values(parts: list[Part], cdr: bool) -> list[tuple[str, str, Any, int]]:
    """Kind, name, constant and count of each value; texts have their length in front, and in CDR a zero behind."""
    values: list[tuple[str, str, Any, int]] = []
    for part in parts:
        if isinstance(part, Field):
            if part.name != "seq" or not cdr:
                values.append((part.kind, part.name, part.value, part.number))
            continue
        text = part.encode() + (b"\x00" if cdr else b"")
        values.append(("<u4", "", len(text), 1))
        if text:
            values.append((f"S{len(text)}", "", text, 1))
    return values
