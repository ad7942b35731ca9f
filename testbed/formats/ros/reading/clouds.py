# SPDX-License-Identifier: MIT
"""Point clouds as scans: of the points between two heights, the nearest in each direction, as pointcloud_to_laserscan
does it.

A direction without a point in the slice is unknown (NaN), not free: something may stand there above or below it.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.formats.log import LogError
from testbed.formats.ros.reading.content import BagContent, Heights
from testbed.formats.ros.reading.decode import RawScan, stamp_of

BINS = 720
"""Directions of a scan: half a degree each, the default of pointcloud_to_laserscan."""
STEP = 2.0 * math.pi / BINS
KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Types of sensor_msgs/PointField."""


def peek_clouds(content: BagContent, reader: Any, connections: list[Any]) -> None:
    """Note the frame of each topic's clouds, by its first message."""
    for connection in connections:
        first = next(reader.messages(connections=[connection]), None)
        if first is not None:
            content.cloud_frames[connection.topic] = reader.deserialize(first[2], connection.msgtype).header.frame_id


def read_clouds(path: Path, content: BagContent, reader: Any, connections: list[Any]) -> None:
    """Read all clouds, one at a time, once the transforms are known; they become scans of `content`."""
    assert content.heights is not None
    robot = content.odometry.child_frame
    places = {frame: content.transforms.place(robot, frame) for frame in content.cloud_frames.values()}
    content.level_mounts = {frame: (float(T[0, 3]), float(T[1, 3]), 0.0) for frame, T in places.items()}
    clouds = [connection for connection in connections if connection.topic in content.cloud_frames]
    for number, (connection, _, raw) in enumerate(reader.messages(connections=clouds), start=1):
        message = reader.deserialize(raw, connection.msgtype)
        try:
            scan = slice_of(message, places[content.cloud_frames[connection.topic]], content.heights)
        except (ValueError, TypeError) as error:
            raise LogError(f"{path}: cloud {number} ({connection.topic}): {error}") from None
        content.scans[connection.topic].append(scan)
        content.places[id(scan)] = f"cloud {number} ({connection.topic})"
    known = sum(int(np.isfinite(scan.ranges).sum()) for scans in content.scans.values() for scan in scans)
    count = sum(map(len, content.scans.values()))
    low, high = content.heights
    where = f"between {low:g} and {high:g} m above {robot or 'the robot'}"
    if not known:
        there = _heights_of_first(reader, clouds, places[content.cloud_frames[clouds[0].topic]]) if clouds else ""
        raise LogError(f"{path}: no point of the clouds lies {where}{there}; choose other heights")
    content.notes.append(f"scans are slices of point clouds {where}: {known / max(count, 1):.0f} of {BINS} directions")


def _heights_of_first(reader: Any, connections: list[Any], T_robot_lidar: NDArray[np.float64]) -> str:
    """Say at which heights the points of the first cloud lie; empty where it has none."""
    connection, _, raw = next(reader.messages(connections=connections))
    points = points_of(reader.deserialize(raw, connection.msgtype))
    if not len(points):
        return ""
    z = points @ T_robot_lidar[2, :3] + T_robot_lidar[2, 3]
    return f", those of the first lie between {z.min():.2f} and {z.max():.2f} m"


def slice_of(message: Any, T_robot_lidar: NDArray[np.float64], heights: Heights) -> RawScan:
    """The scan of a PointCloud2, level, in the robot's directions about the lidar; ValueError where it has no x, y, z.

    heights [m]: lowest and highest z of the points in the robot's frame
    """
    points = points_of(message)
    around = points @ T_robot_lidar[:3, :3].T
    z = around[:, 2] + T_robot_lidar[2, 3]
    x, y = around[(z >= heights[0]) & (z <= heights[1]), :2].T
    distances = np.hypot(x, y)
    bins = np.minimum(((np.arctan2(y, x) + math.pi) / STEP).astype(np.int64), BINS - 1)
    ranges = np.full(BINS, np.inf)
    seen = distances > 0.0  # zeros stand for no point
    np.minimum.at(ranges, bins[seen], distances[seen])
    ranges[np.isinf(ranges)] = np.nan
    first = -math.pi + 0.5 * STEP
    last = first + STEP * (BINS - 1)
    frame = message.header.frame_id
    return RawScan(stamp_of(message), frame, first, last, STEP, 0.0, 0.0, math.inf, ranges.astype(np.float32))


def points_of(message: Any) -> NDArray[np.float64]:
    """The finite points of a PointCloud2, organised or not, (n, 3) [m]; ValueError where it has no x, y, z."""
    order = ">" if message.is_bigendian else "<"
    fields = {field.name: field for field in message.fields}
    if missing := [name for name in "xyz" if name not in fields]:
        raise ValueError(f"no field {', '.join(missing)}; there is: {', '.join(fields) or 'nothing'}")
    width, height, step, row_step = message.width, message.height, message.point_step, message.row_step
    data = np.asarray(message.data, dtype=np.uint8)
    row_step = row_step or width * step
    if width * step > row_step or row_step * height > data.size:
        raise ValueError(f"{height} rows of {width} points of {step} bytes do not fit into {data.size} bytes")
    rows = data[: row_step * height].reshape(height, row_step)[:, : width * step].reshape(-1, step)
    columns = []
    for name in "xyz":
        field = fields[name]
        if field.datatype not in KINDS or field.offset + np.dtype(KINDS[field.datatype]).itemsize > step:
            raise ValueError(f"field {name}: type {field.datatype} at byte {field.offset} of {step}")
        kind = np.dtype(order + KINDS[field.datatype])
        raw = np.ascontiguousarray(rows[:, field.offset : field.offset + kind.itemsize])
        columns.append(raw.view(kind).reshape(-1).astype(np.float64))
    points = np.column_stack(columns)
    finite: NDArray[np.float64] = points[np.isfinite(points).all(axis=1)]
    return finite
