# SPDX-License-Identifier: MIT
"""Point clouds as scans: of the points between two heights, the nearest in each direction, as pointcloud_to_laserscan
does it.

A direction without a point in the slice is unknown (NaN), not free: something may stand there above or below it.
"""

from __future__ import annotations

import math
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.formats.log import LogError
from testbed.formats.ros.packing import messages
from testbed.formats.ros.reading.content import BagContent, Heights
from testbed.formats.ros.reading.decode import RawScan, stamp_of
from testbed.formats.ros.reading.raw_scans import ScanRecorder

USUAL_COUNT, MAX_COUNT = 720, 4096
"""Directions of a scan: half a degree each, the default of pointcloud_to_laserscan; and where they are the lidar's own,
so many at most."""
SAMPLE, MIN_AGREEMENT = 20, 0.9
"""So many clouds show whether a lidar has directions of its own: points lie in their middles, and the mean of unit
vectors of their places within them is that long at least."""
MIN_POINTS, PARTS, MIN_UNITY = 180, 60, 0.9
"""Points of a cloud, cut into so many parts in their order: those of a part of a turn look the same way, the mean of
their unit vectors being that long at least."""
FULL = math.radians(300.0), math.radians(380.0)
"""A full turn, as the middles of the first and of the last part show it [rad]."""
TIME_FIELDS = ("time", "t", "timestamp", "time_stamp", "offset_time")
"""Names that drivers give to the times of points."""
MIN_TURN, MAX_TURN = 1e-3, 1.0
"""The points of a cloud are taken within [s]."""
KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Types of sensor_msgs/PointField."""


def peek_clouds(content: BagContent, reader: Any, connections: list[Any]) -> None:
    """Note the frame of each topic's clouds, by its first message."""
    for connection in connections:
        first = next(messages(reader, [connection]), None)
        if first is not None:
            content.cloud_frames[connection.topic] = reader.deserialize(first[2], connection.msgtype).header.frame_id


def read_clouds(path: Path, content: BagContent, reader: Any, connections: list[Any]) -> None:
    """Read all clouds, one at a time, once the transforms are known; they become scans of `content`."""
    assert content.selection.heights is not None
    robot = content.odometry.child_frame
    places = {frame: content.transforms.place(robot, frame) for frame in content.cloud_frames.values()}
    content.level_mounts = {frame: (float(T[0, 3]), float(T[1, 3]), 0.0) for frame, T in places.items()}
    clouds = [connection for connection in connections if connection.topic in content.cloud_frames]
    directions = {c.topic: _directions_of(reader, c, places[content.cloud_frames[c.topic]], content) for c in clouds}
    recorders = {topic: ScanRecorder(content.scan_store) for topic in content.scans}
    known = timed = 0
    for number, (connection, _, raw) in enumerate(messages(reader, clouds), start=1):
        message = reader.deserialize(raw, connection.msgtype)
        topic = connection.topic
        try:
            scan = slice_of(message, places[content.cloud_frames[topic]], content.selection.heights, directions[topic])
        except (ValueError, TypeError) as error:
            raise LogError(f"{path}: cloud {number} ({connection.topic}): {error}") from None
        recorders[topic].take(scan, number, f"cloud {{}} ({topic})")
        known += int(np.isfinite(scan.ranges).sum())
        timed += scan.time_increment > 0.0
    content.scans = {topic: recorder.finish() for topic, recorder in recorders.items()}
    count = sum(map(len, content.scans.values()))
    low, high = content.selection.heights
    where = f"between {low:g} and {high:g} m above {robot or 'the robot'}"
    if not known:
        there = _heights_of_first(reader, clouds, places[content.cloud_frames[clouds[0].topic]]) if clouds else ""
        raise LogError(f"{path}: no point of the clouds lies {where}{there}; choose other heights")
    content.notes.append(
        f"scans are slices of point clouds {where}: {known / max(count, 1):.0f} of "
        f"{max(d.number for d in directions.values())} directions"
    )
    if timed:
        content.notes.append(f"the points of {timed} of {count} clouds have times: so have the beams")


def _directions_of(reader: Any, connection: Any, T_robot_lidar: NDArray[np.float64], content: BagContent) -> Directions:
    """The directions of the lidar of a topic."""
    assert content.selection.heights is not None
    angles = []
    for _, _, raw in islice(messages(reader, [connection]), SAMPLE):
        with suppress(ValueError, TypeError):  # it is complained about later, with its place
            message = reader.deserialize(raw, connection.msgtype)
            angles.append(_part_of(message, T_robot_lidar, content.selection.heights).angles)
    return find_directions(angles) if angles else USUAL_DIRECTIONS


def _heights_of_first(reader: Any, connections: list[Any], T_robot_lidar: NDArray[np.float64]) -> str:
    """Say at which heights the points of the first cloud lie; empty where it has none."""
    connection, _, raw = next(messages(reader, connections))
    points, _ = points_of(reader.deserialize(raw, connection.msgtype))
    if not len(points):
        return ""
    z = points @ T_robot_lidar[2, :3] + T_robot_lidar[2, 3]
    return f", those of the first lie between {z.min():.2f} and {z.max():.2f} m"


class Directions(NamedTuple):
    """Equal parts of the circle."""

    number: int = USUAL_COUNT
    first: float = -math.pi + math.pi / USUAL_COUNT
    """Middle of the first [rad]."""

    @property
    def step(self) -> float:
        """[rad]"""
        return 2.0 * math.pi / self.number

    def of(self, angles: NDArray[np.float64]) -> NDArray[np.int64]:
        """Numbers of the directions of points (n,)."""
        return np.floor((angles - self.first) / self.step + 0.5).astype(np.int64) % self.number


USUAL_DIRECTIONS = Directions()


def find_directions(angles: list[NDArray[np.float64]]) -> Directions:
    """The directions of a lidar by the angles [rad] of the points of some clouds; the usual ones where it has none of
    its own, such as a depth camera."""
    spacings = np.concatenate([np.diff(np.sort(of_cloud)) for of_cloud in angles])
    spacings = spacings[spacings > 2.0 * math.pi / MAX_COUNT / 2.0]  # points above each other have one direction
    count = round(2.0 * math.pi / float(np.median(spacings))) if spacings.size else 0
    if not USUAL_COUNT // 4 <= count <= MAX_COUNT:
        return USUAL_DIRECTIONS
    mean = complex(np.exp(1j * count * np.concatenate(angles)).mean())
    if abs(mean) < MIN_AGREEMENT:
        return USUAL_DIRECTIONS
    step = 2.0 * math.pi / count
    return Directions(count, -math.pi + (float(np.angle(mean)) / count + math.pi) % step)


def slice_of(
    message: Any, T_robot_lidar: NDArray[np.float64], heights: Heights, directions: Directions = USUAL_DIRECTIONS
) -> RawScan:
    """The scan of a PointCloud2, level, in the robot's directions about the lidar; ValueError where it has no x, y, z.

    heights [m]: lowest and highest z of the points in the robot's frame

    Where the points come in the order of a full turn, so do the beams; they have times where the points have.
    """
    part = _part_of(message, T_robot_lidar, heights)
    count, stamp, frame = directions.number, stamp_of(message), message.header.frame_id
    ranges = np.full(count, np.inf)
    np.minimum.at(ranges, directions.of(part.angles), part.distances)
    ranges[np.isinf(ranges)] = np.nan
    first, way, beat = 0, 1, 0.0
    sweep = find_sweep(part.angles, part.times)
    if sweep is not None:
        first, way = int(directions.of(np.array([sweep.start]))[0]), sweep.way
        ranges = ranges[(first + way * np.arange(count)) % count]
        if sweep.seconds is not None:
            beat, stamp = sweep.seconds / count, stamp + sweep.begin
    begin, step = directions.first + first * directions.step, way * directions.step
    last = begin + step * (count - 1)
    return RawScan(stamp, frame, begin, last, step, beat, 0.0, math.inf, ranges.astype(np.float32))


class _Slice(NamedTuple):
    """The points of a cloud that lie between two heights, in their order."""

    angles: NDArray[np.float64]
    """[rad], (n,)."""
    distances: NDArray[np.float64]
    """[m], (n,)."""
    times: NDArray[np.float64] | None
    """After the stamp of the cloud [s], (n,); None = unknown."""


def _part_of(message: Any, T_robot_lidar: NDArray[np.float64], heights: Heights) -> _Slice:
    points, times = points_of(message)
    around = points @ T_robot_lidar[:3, :3].T
    z, distances = around[:, 2] + T_robot_lidar[2, 3], np.hypot(around[:, 0], around[:, 1])
    chosen = (z >= heights[0]) & (z <= heights[1]) & (distances > 0.0)  # zeros stand for no point
    angles = np.arctan2(around[chosen, 1], around[chosen, 0])
    return _Slice(angles, distances[chosen], None if times is None else times[chosen])


class Sweep(NamedTuple):
    """How a lidar turned while the points of a cloud were taken."""

    start: float
    """Direction of its first point [rad]."""
    way: int
    """1 = counter-clockwise, -1 = clockwise."""
    begin: float
    """Time of the first point after the stamp of the cloud [s]."""
    seconds: float | None
    """Time of a full turn [s]; None = unknown."""


def find_sweep(angles: NDArray[np.float64], times: NDArray[np.float64] | None) -> Sweep | None:
    """The full turn in which points were taken; None where their order is none of a turn.

    angles (n,) of the points in their order [rad];  times (n,) after the stamp [s], None = unknown
    """
    if len(angles) < MIN_POINTS:
        return None
    if times is not None:
        order = np.argsort(times, kind="stable")
        angles, times = angles[order], times[order]
    begins = np.linspace(0, len(angles), PARTS, endpoint=False).astype(np.int64)
    counts = np.diff(np.append(begins, len(angles)))
    middle = np.add.reduceat(np.exp(1j * angles), begins) / counts
    steps = np.angle(middle[1:] / middle[:-1])
    turned = float(steps.sum())
    way = 1 if turned > 0.0 else -1
    if np.abs(middle).min() < MIN_UNITY or (way * steps <= 0.0).any() or not FULL[0] < abs(turned) < FULL[1]:
        return None
    if times is None:
        return Sweep(float(angles[0]), way, 0.0, None)
    per_radian, begin = np.polyfit(
        np.concatenate([[0.0], np.cumsum(steps)]), np.add.reduceat(times, begins) / counts, 1
    )
    begin += per_radian * float(np.angle(np.exp(1j * angles[0]) / middle[0]))
    return Sweep(float(angles[0]), way, float(begin), float(2.0 * math.pi * abs(per_radian)))


def points_of(message: Any) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """The finite points of a PointCloud2, organised or not, (n, 3) [m], and their times after its stamp (n,) [s], None
    where it has none; ValueError where it has no x, y, z. Those of an organised cloud come column by column.
    """
    fields = {field.name: field for field in message.fields}
    if missing := [name for name in "xyz" if name not in fields]:
        raise ValueError(f"no field {', '.join(missing)}; there is: {', '.join(fields) or 'nothing'}")
    width, height, step, row_step = message.width, message.height, message.point_step, message.row_step
    data = np.asarray(message.data, dtype=np.uint8)
    row_step = row_step or width * step
    if width * step > row_step or row_step * height > data.size:
        raise ValueError(f"{height} rows of {width} points of {step} bytes do not fit into {data.size} bytes")
    rows = data[: row_step * height].reshape(height, row_step)[:, : width * step]
    rows = rows.reshape(height, width, step).transpose(1, 0, 2).reshape(-1, step)
    order = ">" if message.is_bigendian else "<"
    with np.errstate(invalid="ignore"):  # bytes may be a NaN that signals
        points = np.column_stack([_column(rows, fields[name], order).astype(np.float64) for name in "xyz"])
    finite = np.isfinite(points).all(axis=1)
    clock = next((fields[name] for name in TIME_FIELDS if name in fields), None)
    times = None if clock is None else seconds_after(_column(rows, clock, order)[finite], stamp_of(message))
    return points[finite], times


def _column(rows: NDArray[np.uint8], field: Any, order: str) -> NDArray[Any]:
    """One field of all points (n,); rows (n, bytes of a point)."""
    step = rows.shape[1]
    if field.datatype not in KINDS or field.offset + np.dtype(KINDS[field.datatype]).itemsize > step:
        raise ValueError(f"field {field.name}: type {field.datatype} at byte {field.offset} of {step}")
    kind = np.dtype(order + KINDS[field.datatype])
    values: NDArray[Any] = np.ascontiguousarray(rows[:, field.offset : field.offset + kind.itemsize]).view(kind)
    return values.reshape(-1)


def seconds_after(times: NDArray[Any], stamp: float) -> NDArray[np.float64] | None:
    """Times of points (n,) as seconds after the stamp of their cloud [s]; None where they make no sense.

    Velodyne's `time` and Ouster's `t` count from the stamp, in seconds and nanoseconds; RoboSense's `timestamp` are
    seconds since 1970. The unit is the one in which the points of a cloud span between a millisecond and `MAX_TURN`.
    """
    if not times.size or not np.isfinite(times).all():
        return None
    units = (1.0,) if times.dtype.kind == "f" and np.abs(times).max() < 1e3 else (1.0, 1e-3, 1e-6, 1e-9)
    span = float(times.max()) - float(times.min())
    unit = next((unit for unit in units if MIN_TURN <= span * unit <= MAX_TURN), None)
    if unit is None:
        return None
    first = float(times.min()) * unit
    relative = (times - times.min()).astype(np.float64) * unit  # before it is a float: nanoseconds have 19 digits
    begin = first if abs(first) <= MAX_TURN else first - stamp  # by the clock of the stamps
    after: NDArray[np.float64] = relative + begin
    return after if abs(begin) <= MAX_TURN else None
