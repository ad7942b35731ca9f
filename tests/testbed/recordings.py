# SPDX-License-Identifier: MIT
"""A short recording that every format can hold, and what of it must come back."""

import math
from pathlib import Path

import numpy as np
import pytest

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from testbed.formats import Log, open_log
from testbed.formats.write import HOLDS, write_log
from testbed.frame import Frame

LOG_FORMATS = [log_format for log_format in HOLDS if log_format != "map_server"]
ANGLES = np.deg2rad(-90.0 + np.arange(181))  # the one layout that FLASER readers know, so that it can go everywhere
MOUNTS = {"laser": (0.125, 0.0, 0.0), "rear_laser": (-0.25, 0.0, math.pi)}
GRID = OccupancyGrid(
    probability=np.array([[0.0, 1.0, np.nan], [1.0, 0.0, 0.0]], dtype=np.float32),
    resolution=0.05,
    origin=(-1.0, 2.0, 0.5),
)
SUFFIX = {"rosbag1": ".bag", "carmen": ".log.gz"}
URDF = '<robot name="r"><link name="base_link"/></robot>'


def two_lidar_drive() -> Log:
    """Twelve frames, scans of two lidars in turn."""
    rng, frames = np.random.default_rng(0), []
    for k in range(12):
        lidar = (None, "laser", None, "rear_laser")[k % 4]
        ranges = np.round(rng.uniform(0.25, 9.0, 181) * 64) / 64
        scan = Scan(
            ranges=np.where(ranges > 7.5, math.inf, ranges),
            angles=ANGLES,
            range_min=0.125,
            range_max=8.0,
            stamp=k / 8,
            mount=MOUNTS[lidar or "laser"],
            time_offsets=2.0**-12 * np.arange(181),
        )
        frames.append(
            Frame(
                stamp=k / 8,
                odometry=rng.uniform(-3, 3, 3),
                scan=scan if lidar else None,
                lidar=lidar or "laser",
                twist=np.array([rng.normal(), 0.0, rng.normal()]),
                command=(float(rng.normal()), float(rng.normal())),
                truth=rng.uniform(-3, 3, 3),
            )
        )
    return Log.from_frames(frames, path=Path("made"), format="made", truth_map=GRID, robot_urdf=URDF)


def write_frames(path: Path, frames: list[Frame], log_format: str = "carmen") -> None:
    """Write frames that belong to no log."""
    write_log(path, Log.from_frames(frames, path=Path("made"), format="made"), log_format)


def through(folder: Path, log: Log, *log_formats: str) -> Log:
    """The log after it was written and read in these formats, one after the other."""
    for number, log_format in enumerate(log_formats):
        out = folder / f"{number}-{log_format}{SUFFIX.get(log_format, '')}"
        write_log(out, log, log_format)
        log = open_log(out, scans_needed=False)
    return log


def assert_same(read: Log, written: Log, log_formats: tuple[str, ...]) -> None:
    """Equal in all parts that all formats hold."""
    held = frozenset.intersection(*(HOLDS[log_format] for log_format in log_formats))
    assert [frame.stamp for frame in read.frames] == [frame.stamp for frame in written.frames]
    for got, put in zip(read.frames, written.frames, strict=True):
        for part in ("odometry", "truth"):
            np.testing.assert_allclose(getattr(got, part), getattr(put, part), atol=1e-12)
        if "twist" in held:
            np.testing.assert_array_equal(got.twist, put.twist)
        if "command" in held:
            assert got.command == put.command
        assert (got.scan is None) == (put.scan is None or "scans" not in held)
        if got.scan is not None:
            assert_same_scan(got.scan, put.scan, exact="beam times" in held)
            assert got.lidar == put.lidar
    if "true map" in held:
        np.testing.assert_array_equal(read.truth_map.probability, GRID.probability)
        assert (read.truth_map.resolution, read.truth_map.origin) == (0.05, pytest.approx(GRID.origin))
        assert read.robot_urdf == URDF


def assert_same_scan(got: Scan, put: Scan, *, exact: bool) -> None:
    np.testing.assert_array_equal(got.hit, put.hit)
    np.testing.assert_array_equal(got.no_return, put.no_return)
    np.testing.assert_array_equal(got.ranges[got.hit], put.ranges[put.hit])
    np.testing.assert_allclose(got.angles, put.angles, atol=1e-5)  # 180 steps of a float32
    np.testing.assert_allclose(se2.between(got.mount, put.mount), 0.0, atol=1e-9)
    assert got.range_max == put.range_max
    if exact:
        np.testing.assert_array_equal(got.ranges, put.ranges)
        np.testing.assert_array_equal(got.time_offsets, put.time_offsets)
        assert got.range_min == put.range_min
