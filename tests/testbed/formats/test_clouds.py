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
from testbed.formats.ros.reading.clouds import USUAL_COUNT, Directions, find_directions, find_sweep, slice_of
from testbed.inspect import Reading
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
    "velodyne with times": (
        [("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8), ("ring", "<u2", 16), ("time", "<f4", 18)],
        22,
    ),
    "ouster": ([("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8), ("t", "<u4", 20)], 48),
    "robosense with times": ([("x", "<f4", 0), ("y", "<f4", 4), ("z", "<f4", 8), ("timestamp", "<f8", 18)], 26),
    "double": ([("z", "<f8", 0), ("x", "<f8", 8), ("y", "<f8", 16)], 24),
    "big-endian": ([("x", ">f4", 0), ("y", ">f4", 4), ("z", ">f4", 8)], 16),
}
NUMBERS = {"u2": 4, "u4": 6, "f4": 7, "f8": 8}
STEP = 2.0 * math.pi / USUAL_COUNT


def cloud(points, layout="xyz", rows=1, padding=0, **more):
    """A PointCloud2 of points (n, 3); organised in rows, each with some bytes behind it; more: other fields."""
    fields, step = LAYOUTS[layout]
    names, kinds, offsets = zip(*fields, strict=True)
    records = np.zeros(len(points), np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": step}))
    records["x"], records["y"], records["z"] = np.asarray(points).T
    for name, values in more.items():
        records[name] = values
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


def ring(radius, z, count=USUAL_COUNT):
    angles = -math.pi + 2.0 * math.pi / count * (np.arange(count) + 0.5)
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
    assert scan.ranges[USUAL_COUNT // 2] == pytest.approx(2.0)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize(
    ("layout", "field", "values"),
    [
        ("velodyne with times", "time", lambda share: 0.1 * (share - 1.0)),
        ("ouster", "t", lambda share: 1e8 * share),
        ("robosense with times", "timestamp", lambda share: 2.96 + 0.1 * share),
    ],
)
def test_times_of_points_become_times_of_beams(layout, field, values, way):
    """Sixteen rings, and the clouds' points in any order: time tells it."""
    share = np.linspace(0.0, 1.0, 900, endpoint=False)
    angles = 0.8 + way * 2.0 * math.pi * share
    rings = [np.column_stack([np.cos(angles), np.sin(angles), np.full(900, 0.1 * k)]) for k in range(16)]
    order = np.random.default_rng(1).permutation(16 * 900)
    message = cloud(4.0 * np.vstack(rings)[order], layout, **{field: values(np.tile(share, 16)[order])})
    scan = slice_of(message, np.eye(4), (0.1, 0.5), find_directions([np.unwrap(angles)]))
    assert len(scan.ranges) == 900
    assert scan.angle_increment == pytest.approx(way * math.radians(0.4))
    assert scan.angle_min == pytest.approx(0.8, abs=math.radians(0.5))
    assert scan.time_increment * 900 == pytest.approx(0.1, rel=0.01)
    first = values(0.0) if field != "timestamp" else values(0.0) - 3.0
    assert scan.stamp == pytest.approx(3.0 + first * (1e-9 if field == "t" else 1.0), abs=1e-3)


@pytest.mark.parametrize("times", [np.full(900, np.nan), np.zeros(900), np.linspace(0.0, 1e12, 900)])
def test_times_that_make_no_sense_are_none(times):
    points = 3.0 * ring(1.0, 0.1, 900)
    scan = slice_of(cloud(points, "velodyne with times", time=times), np.eye(4), (0.1, 0.5))
    assert (scan.stamp, scan.time_increment) == (3.0, 0.0)


def test_points_in_no_order_and_views_of_a_camera_are_no_turn():
    angles = np.linspace(-math.pi, math.pi, 720, endpoint=False)
    assert find_sweep(angles, None) == (-math.pi, 1, 0.0, None)
    assert find_sweep(angles[::-1], None).way == -1
    assert find_sweep(np.random.default_rng(1).permutation(angles), None) is None
    assert find_sweep(angles[300:420].repeat(4), None) is None


@pytest.mark.parametrize("count", [360, 800, 1800])
def test_the_directions_are_those_of_the_lidar(count):
    rng = np.random.default_rng(count)
    angles = -math.pi + 0.3 * 2.0 * math.pi / count + 2.0 * math.pi / count * np.arange(count)
    seen = [angles[rng.random(count) < 0.7] for _ in range(5)]
    found = find_directions(seen)
    assert found.number == count
    np.testing.assert_array_equal(found.of(angles), np.arange(count))
    assert find_directions([rng.uniform(-0.5, 0.5, 640)]) == Directions()


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
    assert max(apart) < 1e-5
    assert len(hits[0]) > 400


def test_clouds_in_the_order_of_a_turn_have_the_times_of_the_scans(tmp_path):
    config = SimulationConfig(backend="fast", duration=20.0)
    write_dataset(tmp_path / "drive", load("office"), config, {"seed": 0}, log_format="rosbag2")
    scans, slices = (Reading(slice=heights).open(tmp_path / "drive") for heights in (None, "0,0.5"))
    assert any("a turn of 0.100 s that begins at the stamp" in note for note in slices.repairs)
    (scan,), (of_slice,) = ({table.scan_patterns[-1] for table in (log.table,)} for log in (scans, slices))
    scan, of_slice = scans.table.patterns[scan], slices.table.patterns[of_slice]
    turned = (of_slice.angles[:, None] - scan.angles + math.pi) % (2.0 * math.pi) - math.pi
    nearest = np.abs(turned).argmin(axis=1)
    np.testing.assert_allclose(of_slice.time_offsets, scan.time_offsets[nearest], atol=2e-4)


def ends(table, number):
    """Where the beams of a scan end in the frame of the robot (n, 2) [m]."""
    scan = table.scan(number)
    hit = (scan.ranges >= scan.range_min) & (scan.ranges < scan.range_max)
    return se2.transform_points(
        np.array(scan.mount), scan.ranges[hit, None] * np.column_stack([np.cos(scan.angles), np.sin(scan.angles)])[hit]
    )
