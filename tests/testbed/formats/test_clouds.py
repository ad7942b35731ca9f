# SPDX-License-Identifier: MIT
"""Point clouds as scans: the points of one slice, in the frames and layouts that lidars and depth cameras have."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from slam import se2
from testbed.datasets.simulated import write_dataset
from testbed.formats import LogError, open_log
from testbed.formats.ros.reading.clouds import BINS, STEP, slice_of
from testbed.simulation import SimulationConfig
from worlds import load

TYPES = get_typestore(Stores.ROS2_JAZZY).types
HEADER = TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](3, 0), "lidar")
LAYOUTS = {
    "xyz": ([("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8)], 12),
    "velodyne": (
        [("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8), ("intensity", "<f4", 12), ("ring", "<u2", 16)],
        22,
    ),
    "robosense": (
        [("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8), ("intensity", "<f4", 16), ("time", "<f8", 24)],
        32,
    ),
    "double": ([("z", "<f8", 0), ("x", "<f8", 8), ("y", "<f8", 16)], 24),
    "big-endian": ([("x", ">f4", 0), ("y", ">f4", 4), ("z", ">f4", 8)], 16),
}
NUMBERS = {"u2": 4, "f4": 7, "f8": 8}


def cloud(points, layout="xyz", rows=1, padding=0):
    """A PointCloud2 of points (n, 3); organised in rows, each with some bytes behind it."""
    fields, step = LAYOUTS[layout]
    names, kinds, offsets = zip(*fields, strict=True)
    records = np.zeros(len(points), np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": step}))
    records["x"], records["y"], records["z"] = np.asarray(points).T
    width = len(points) // rows
    data = np.pad(records.view(np.uint8).reshape(rows, width * step), ((0, 0), (0, padding)), constant_values=255)
    return TYPES["sensor_msgs/msg/PointCloud2"](
        header=HEADER,
        height=rows,
        width=width,
        fields=[TYPES["sensor_msgs/msg/PointField"](n, o, NUMBERS[k[1:]], 1) for n, k, o in fields],
        is_bigendian=kinds[0].startswith(">"),
        point_step=step,
        row_step=data.shape[1],
        data=data.reshape(-1),
        is_dense=False,
    )


def ring(radius, z, count=BINS):
    angles = -math.pi + STEP * (np.arange(count) + 0.5)
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(count, z)])


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(("rows", "padding"), [(1, 0), (6, 0), (6, 10)])
def test_the_nearest_point_of_the_slice_counts(layout, rows, padding):
    points = np.vstack([ring(2.0, 0.05), ring(3.0, 0.3), ring(4.0, 0.4), ring(1.0, 1.0)])
    scan = slice_of(cloud(points, layout, rows, padding), np.eye(4), (0.1, 0.5))
    np.testing.assert_allclose(scan.ranges, 3.0, rtol=1e-6)
    assert scan.stamp == 3.0
    assert scan.angle_min == pytest.approx(-math.pi + 0.5 * STEP)


def test_directions_without_a_point_are_unknown():
    scan = slice_of(cloud(np.array([[2.0, 0.001, 0.2], [np.nan, 1.0, 0.2], [0.0, 0.0, 0.2]])), np.eye(4), (0.1, 0.5))
    assert np.isfinite(scan.ranges).sum() == 1
    assert scan.ranges[BINS // 2] == pytest.approx(2.0)


@pytest.mark.parametrize(
    "turn", [(0.0, 0.0, 0.7), (0.0, 0.35, 0.0), (-math.pi / 2, 0.0, -math.pi / 2), (math.pi, 0, 0)]
)
def test_a_lidar_that_leans_sees_the_same(turn):
    """The points of a wall around the robot, given in the frame of a lidar however it is turned."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("xyz", turn).as_matrix(), (0.0, 0.0, 0.6)
    wall = np.vstack([ring(3.0, z) for z in (0.05, 0.3, 0.9)])
    seen = (wall - T[:3, 3]) @ T[:3, :3]
    np.testing.assert_allclose(slice_of(cloud(seen, "double"), T, (0.1, 0.5)).ranges, 3.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"fields": []}, "no field x, y, z"),
        ({"width": 9999}, "do not fit"),
        ({"point_step": 10}, "type 7 at byte 8 of 10"),
    ],
)
def test_clouds_that_make_no_sense_are_refused(change, complaint):
    changed = {"row_step": 0} | change
    with pytest.raises(ValueError, match=complaint):
        slice_of(replace(cloud(ring(2.0, 0.2)), **changed), np.eye(4), (0.1, 0.5))


def test_a_bag_of_clouds_is_the_bag_of_scans(tmp_path):
    config = SimulationConfig(backend="fast", duration=4.0)
    write_dataset(tmp_path / "drive", load("office"), config, {"seed": 0}, log_format="rosbag2")
    scans = open_log(tmp_path / "drive").table
    with pytest.raises(LogError, match=r"first lie between 0\.00 and 0\.00 m; choose other heights"):
        open_log(tmp_path / "drive", heights=(1.5, 2.0))
    slices = open_log(tmp_path / "drive", heights=(0.0, 0.5))
    assert any("scans are slices of point clouds between 0 and 0.5 m" in note for note in slices.repairs)
    table = slices.table
    np.testing.assert_allclose(table.odometry[table.scan_rows], scans.odometry[scans.scan_rows], atol=1e-12)
    np.testing.assert_allclose(table.mounts[0], scans.mounts[0], atol=1e-9)
    hits = [ends(t, 10) for t in (table, scans)]
    apart = [np.hypot(*(hits[1] - hit).T).min() for hit in hits[0]]
    assert max(apart) < 0.05  # a direction is half a degree wide
    assert len(hits[0]) > 400


def ends(table, number):
    """Where the beams of a scan end in the frame of the robot (n, 2) [m]."""
    scan = table.scan(number)
    hit = (scan.ranges >= scan.range_min) & (scan.ranges < scan.range_max)
    return se2.transform_points(
        np.array(scan.mount), scan.ranges[hit, None] * np.column_stack([np.cos(scan.angles), np.sin(scan.angles)])[hit]
    )
