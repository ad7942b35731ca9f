# SPDX-License-Identifier: MIT
"""Serialised ROS messages as arrays.

The messages of a topic mostly have one layout, since their texts do not change. Those are decoded all at once; messages
that differ are deserialised one by one.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.formats.ros import layouts
from testbed.formats.ros.layouts import CDR_HEADER, Encoding, message_layout
from testbed.formats.ros.reading.transforms import MAX_PLACE, MAX_TILT, planar_pose
from testbed.frame_table import Floats

NANOSECONDS = 1_000_000_000
Deserialise = Callable[[bytes], Any]


class Track(NamedTuple):
    """Stamped poses, in the order of the bag."""

    stamps: Floats
    """[s], (n,)."""
    poses: Floats
    """Poses in the plane [m, m, rad], (n, 3)."""
    twists: Floats
    """[m/s, m/s, rad/s], (n, 3)."""
    frame: str = ""
    """Frame that the poses are in."""
    child_frame: str = ""
    """Frame whose poses they are."""

    def first(self, count: int) -> Track:
        """The first messages."""
        return self._replace(stamps=self.stamps[:count], poses=self.poses[:count], twists=self.twists[:count])

    def chosen(self, rows: NDArray[np.bool_]) -> Track:
        """Some of the messages."""
        return self._replace(stamps=self.stamps[rows], poses=self.poses[rows], twists=self.twists[rows])

    def in_time(self) -> Track:
        """The same sorted by time; of equal stamps the first counts."""
        stamps, rows = np.unique(self.stamps, return_index=True)
        return self._replace(stamps=stamps, poses=self.poses[rows], twists=self.twists[rows])


NO_TRACK = Track(np.empty(0), np.empty((0, 3)), np.empty((0, 3)))


class RawScan(NamedTuple):
    """A LaserScan."""

    stamp: float
    """[s]"""
    frame_id: str
    angle_min: float
    angle_max: float
    angle_increment: float
    time_increment: float
    range_min: float
    range_max: float
    ranges: NDArray[np.float32]
    """[m], (beams,)."""


class BadMessageError(ValueError):
    """A message makes no sense; `number` counts the messages of its topic from 0."""

    def __init__(self, number: int, text: str) -> None:
        super().__init__(text)
        self.number = number


def decode_odometry(raws: Sequence[bytes], encoding: Encoding, deserialise: Deserialise) -> Track:
    """The poses and twists of Odometry messages; BadMessageError where a pose is none in the plane."""
    frame, child = _texts(raws[0], encoding, 2) or ("", "")
    rows = _rows(raws, message_layout(layouts.odometry(frame, child), encoding))
    if rows is None:
        messages = [deserialise(raw) for raw in raws]
        return Track(
            np.array([stamp_of(message) for message in messages]),
            _poses([(m.pose.pose.position, m.pose.pose.orientation) for m in messages]),
            np.array([_twist_of(message.twist.twist) for message in messages]),
            messages[0].header.frame_id,
            next((m.child_frame_id for m in messages if m.child_frame_id), ""),
        )
    twists = np.column_stack([rows["linear"][:, :2], rows["angular"][:, 2]])
    return Track(_stamps(rows), _planar(rows["position"], rows["orientation"]), twists, frame, child)


def publishers(raws: Sequence[bytes], encoding: Encoding) -> list[tuple[str, str]]:
    """The frame and the child frame of each Odometry message; that of the first one, or nothing, where they cannot be
    told."""
    cursor = _Cursor(raws[0], encoding)
    if (first := _texts(raws[0], encoding, 2)) is None:
        return [("", "")] * len(raws)
    cursor.header()
    begin = cursor.at
    cursor.texts(2)
    texts = bytes(raws[0][begin : cursor.at])
    if all(bytes(raw[begin : cursor.at]) == texts for raw in raws):
        return [(first[0], first[1])] * len(raws)
    found = [_texts(raw, encoding, 2) for raw in raws]
    return [(texts[0], texts[1]) if texts else (first[0], first[1]) for texts in found]


def decode_truth(raws: Sequence[bytes], kind: str, deserialise: Deserialise) -> Track:
    """The stamped poses of messages of another kind than Odometry; BadMessageError where a pose is none in the plane.

    kind: the type of the messages. A nav_msgs/Path is sent again as it grows: the longest counts.
    """
    messages = [deserialise(raw) for raw in raws]
    if kind.endswith("/Path"):
        messages = list(max(messages, key=lambda message: len(message.poses)).poses)
    pairs = [_position_and_rotation(message) for message in messages]
    stamps = np.array([stamp_of(message) for message in messages])
    return Track(stamps, _poses(pairs), np.full((len(pairs), 3), np.nan))


def _position_and_rotation(message: Any) -> tuple[Any, Any]:
    """Of a PoseStamped, PoseWithCovarianceStamped or TransformStamped."""
    if hasattr(message, "transform"):
        return message.transform.translation, message.transform.rotation
    pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
    return pose.position, pose.orientation


def decode_commands(
    raws: Sequence[bytes], times: Sequence[int], encoding: Encoding, deserialise: Deserialise
) -> Floats:
    """Stamp [s], speed [m/s], turn rate [rad/s] of Twist and TwistStamped messages, (n, 3), in the order of the bag.

    times [ns]: those of the bag, for messages without a clock of their own. Raises BadMessageError for numbers that are
    not finite.
    """
    rows = _rows(raws, message_layout(layouts.twist(), encoding))
    if rows is not None:
        stamps = np.array([seconds(time) for time in times])
        commands = np.column_stack([stamps, rows["linear"][:, 0], rows["angular"][:, 2]])
    else:
        commands = np.array([_command(deserialise(raw), time) for raw, time in zip(raws, times, strict=True)])
    bad = np.flatnonzero(~np.isfinite(commands).all(axis=1))
    if bad.size:
        _, speed, turn_rate = commands[bad[0]].tolist()
        raise BadMessageError(int(bad[0]), f"expected a finite command, got {speed} m/s and {turn_rate} rad/s")
    return commands


def decode_scan(raw: bytes, encoding: Encoding, deserialise: Deserialise) -> RawScan:
    """A LaserScan."""
    read = _Cursor(raw, encoding)
    if not read.known:
        return _scan_of(deserialise(raw))
    try:
        time, (frame_id,) = read.header(), read.texts(1)
        first, last, step, beat, _, low, high = read.numbers("7f")
        (count,) = read.numbers("I")
        return RawScan(time, frame_id, first, last, step, beat, low, high, np.frombuffer(raw, "<f4", count, read.at))
    except (struct.error, ValueError, UnicodeDecodeError):  # the reader of the library says what is wrong
        return _scan_of(deserialise(raw))


def decode_echoes(raw: bytes, deserialise: Deserialise) -> RawScan:
    """A MultiEchoLaserScan, of whose echoes the first in each direction that is a number counts; NaN without any."""
    message = deserialise(raw)
    first = [next((echo for echo in beam.echoes if not math.isnan(echo)), math.nan) for beam in message.ranges]
    return _scan_of(message, np.array(first, dtype=np.float32))


def stamp_of(message: Any) -> float:
    """The stamp in a message's header [s]."""
    time = message.header.stamp
    return seconds(time.sec * NANOSECONDS + time.nanosec)


def seconds(nanoseconds: int) -> float:
    """A time in seconds, correctly rounded since both numbers are integers."""
    return nanoseconds / NANOSECONDS


def _scan_of(message: Any, ranges: NDArray[np.float32] | None = None) -> RawScan:
    numbers = (getattr(message, name) for name in RawScan._fields[2:8])
    first, last, step, beat, low, high = (float(number) for number in numbers)
    if ranges is None:
        ranges = np.asarray(message.ranges, dtype=np.float32)
    return RawScan(stamp_of(message), message.header.frame_id, first, last, step, beat, low, high, ranges)


class _Cursor:
    """Reads the values of one message from its begin."""

    def __init__(self, raw: bytes, encoding: Encoding) -> None:
        self._raw, self._cdr = raw, encoding == "cdr"
        self.known = not self._cdr or bytes(raw[:4]) == CDR_HEADER
        """Whether the byte order is the usual one."""
        self._origin = self.at = len(CDR_HEADER) if self._cdr else 0

    def numbers(self, kinds: str) -> tuple[Any, ...]:
        """Numbers of four bytes each."""
        if self._cdr:
            self.at += -(self.at - self._origin) % 4
        values = struct.unpack_from(f"<{kinds}", self._raw, self.at)
        self.at += struct.calcsize(f"<{kinds}")
        return values

    def header(self) -> float:
        """A std_msgs/Header up to its frame; its stamp [s]."""
        if self._cdr:
            sec, nanosec = self.numbers("iI")
        else:
            _, sec, nanosec = self.numbers("III")
        return seconds(sec * NANOSECONDS + nanosec)

    def texts(self, count: int) -> list[str]:
        """Texts that follow one another."""
        found = []
        for _ in range(count):
            (size,) = self.numbers("I")
            if self.at + size > len(self._raw):
                raise ValueError("a text is longer than its message")
            text = bytes(self._raw[self.at : self.at + size])
            self.at += size
            found.append((text[:-1] if self._cdr else text).decode())
        return found


def _texts(raw: bytes, encoding: Encoding, count: int) -> list[str] | None:
    """The frame in a message's header, and the texts behind it; None where there are none."""
    cursor = _Cursor(raw, encoding)
    try:
        cursor.header()
        return cursor.texts(count) if cursor.known else None
    except (struct.error, ValueError):
        return None


def _rows(raws: Sequence[bytes], template: NDArray[Any]) -> NDArray[Any] | None:
    """Messages as records (n,) of the template's layout; None where one of them has another."""
    size = template.dtype.itemsize
    if any(len(raw) != size for raw in raws):
        return None
    data = np.frombuffer(b"".join(raws), dtype=np.uint8).reshape(len(raws), size)
    fixed = np.ones(size, dtype=bool)
    for name, (kind, offset, *_) in (template.dtype.fields or {}).items():
        if not name.startswith("_") or kind.base.kind == "f":  # covariances may be anything
            fixed[offset : offset + kind.itemsize] = False
    padding = ~_covered(template.dtype)
    padding[: len(CDR_HEADER)] = False
    fixed &= ~padding
    if (data[:, fixed] != template.view(np.uint8)[fixed]).any():
        return None
    rows: NDArray[Any] = data.reshape(-1).view(template.dtype)
    return rows


def _covered(layout: np.dtype[Any]) -> NDArray[np.bool_]:
    """Bytes of a layout that belong to a field."""
    covered = np.zeros(layout.itemsize, dtype=bool)
    for kind, offset, *_ in (layout.fields or {}).values():
        covered[offset : offset + kind.itemsize] = True
    return covered


def _stamps(rows: NDArray[Any]) -> Floats:
    times = rows["sec"].astype(np.int64) * NANOSECONDS + rows["nanosec"]
    return np.array([time / NANOSECONDS for time in times.tolist()])  # integers: correctly rounded


def _planar(positions: Floats, rotations: Floats) -> Floats:
    """x, y, yaw of poses (n, 3): positions (n, 3), quaternions x, y, z, w (n, 4)."""
    qx, qy, qz, qw = rotations.T
    norm = np.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    with np.errstate(invalid="ignore", divide="ignore"):
        qx, qy, qz, qw = qx / norm, qy / norm, qz / norm, qw / norm
        level = 1 - 2 * (qx * qx + qy * qy) >= math.cos(MAX_TILT)
        sound = (np.abs(positions) <= MAX_PLACE).all(axis=1) & (np.abs(norm - 1.0) < 0.01) & level
    for number in np.flatnonzero(~sound).tolist():
        position, rotation = positions[number].tolist(), rotations[number].tolist()
        _poses([(_named("xyz", position), _named("xyzw", rotation))], number)  # says what is wrong
    sines, cosines = 2 * (qx * qy + qz * qw), 1 - 2 * (qy * qy + qz * qz)
    # The C library's arc tangent is the same on all processors, that of numpy is not.
    yaw = np.fromiter(map(math.atan2, sines.tolist(), cosines.tolist()), np.float64, len(sines))
    return np.column_stack([positions[:, :2], yaw])


def _named(names: str, values: list[float]) -> SimpleNamespace:
    return SimpleNamespace(**dict(zip(names, values, strict=True)))


def _poses(pairs: Sequence[tuple[Any, Any]], first: int = 0) -> Floats:
    """Poses in the plane of positions and quaternions, (n, 3)."""
    poses = []
    for number, (position, rotation) in enumerate(pairs):
        try:
            poses.append(planar_pose(position, rotation))
        except ValueError as error:
            raise BadMessageError(first + number, str(error)) from None
    return np.array(poses).reshape(-1, 3)


def _twist_of(twist: Any) -> tuple[float, float, float]:
    return float(twist.linear.x), float(twist.linear.y), float(twist.angular.z)


def _command(message: Any, time: int) -> tuple[float, float, float]:
    """Stamp, speed and turn rate; only stamped messages have a clock of their own."""
    stamp, twist = (stamp_of(message), message.twist) if hasattr(message, "header") else (seconds(time), message)
    return stamp, float(twist.linear.x), float(twist.angular.z)
