# SPDX-License-Identifier: MIT
"""All formats against each other: what both can hold comes through."""

import itertools
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from testbed.formats import Log, LogError, open_log
from testbed.formats.writing import HOLDS, parts_of, write_log
from testbed.frame import Frame

FORMS = [form for form in HOLDS if form != "map_server"]
ANGLES = np.deg2rad(-90.0 + np.arange(181))  # the one layout that FLASER readers know, so that it can go everywhere
MOUNTS = {"laser": (0.125, 0.0, 0.0), "rear_laser": (-0.25, 0.0, math.pi)}
GRID = OccupancyGrid(
    probability=np.array([[0.0, 1.0, np.nan], [1.0, 0.0, 0.0]], dtype=np.float32),
    resolution=0.05,
    origin=(-1.0, 2.0, 0.5),
)
SUFFIX = {"rosbag1": ".bag", "carmen": ".log.gz"}
URDF = '<robot name="r"><link name="base_link"/></robot>'

pose = st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-3.1, 3.1)).map(np.array)
single = st.floats(0.125, 7.5, width=32)  # what float32 holds
reading = st.one_of(single, st.sampled_from([math.inf, math.nan, -math.inf]))


@st.composite
def scans(draw, lidar: str, stamp: float):
    few = draw(st.lists(reading, min_size=1, max_size=8))
    return Scan(
        ranges=np.resize(few, 181),
        angles=ANGLES,
        range_min=0.125,
        range_max=8.0,
        stamp=stamp,
        mount=MOUNTS[lidar],
        time_offsets=2.0**-12 * np.arange(181),
    )


@st.composite
def logs(draw):
    count, frames = draw(st.integers(1, 6)), []
    start = draw(st.integers(0, 2**30))
    for k in range(count):
        lidar = draw(st.sampled_from([None, "laser", "rear_laser"]))
        stamp = start + k / 8
        frames.append(
            Frame(
                stamp=stamp,
                odometry=draw(pose),
                scan=None if lidar is None else draw(scans(lidar, stamp)),
                lidar=lidar or "laser",
                twist=np.array([draw(single), 0.0, draw(single)]),
                command=(draw(single), draw(single)),
                truth=draw(pose),
            )
        )
    return Log(path=Path("made"), format="made", frames=frames, notes=(), truth_map=GRID, robot_urdf=URDF)


def through(folder: Path, log: Log, *forms: str) -> Log:
    """The log after it was written and read in these formats, one after the other."""
    for number, form in enumerate(forms):
        out = folder / f"{number}-{form}{SUFFIX.get(form, '')}"
        write_log(out, log, form)
        log = open_log(out, scans_needed=False)
    return log


def assert_same(read: Log, written: Log, forms: tuple[str, ...]) -> None:
    """Equal in all parts that all formats hold."""
    held = frozenset.intersection(*(HOLDS[form] for form in forms))
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


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=8, deadline=None, derandomize=True)
@given(log=logs())
def test_a_format_keeps_what_it_can_hold(tmp_path_factory, form, log):
    folder = tmp_path_factory.mktemp("trip")
    assert_same(through(folder, log, form), log, (form,))
    shutil.rmtree(folder)


@pytest.mark.parametrize(("first", "second"), list(itertools.permutations(FORMS, 2)))
def test_a_round_trip_loses_nothing_that_both_formats_hold(tmp_path, drive, first, second):
    assert_same(through(tmp_path, drive, first, second, first), drive, (first, second))


@pytest.fixture(scope="module")
def drive() -> Log:
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
    return Log(path=Path("made"), format="made", frames=frames, notes=(), truth_map=GRID, robot_urdf=URDF)


@pytest.mark.parametrize("form", FORMS)
def test_equal_logs_give_equal_bytes(tmp_path, drive, form):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_log(tmp_path / folder / f"log{SUFFIX.get(form, '')}", drive, form)
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert files
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_the_true_map_alone_is_written_for_map_server(tmp_path, drive):
    from eval.map_server import read_map

    write_log(tmp_path / "map.yaml", drive, "map_server")
    np.testing.assert_array_equal(read_map(tmp_path / "map.yaml").probability, GRID.probability)
    bare = Log(path=Path("bare"), format="made", frames=drive.frames, notes=())
    with pytest.raises(LogError, match="bare: holds no true map"):
        write_log(tmp_path / "other.yaml", bare, "map_server")


def test_parts_of_a_log(drive):
    assert parts_of(drive) == HOLDS["parquet"] - {"lidar names"}  # CARMEN has these two names
    assert parts_of(Log(path=Path("p"), format="f", frames=[Frame(stamp=0.0, odometry=np.zeros(3))], notes=())) == {
        "odometry"
    }


def test_what_is_there_is_not_overwritten(tmp_path, drive):
    (tmp_path / "log").mkdir()
    with pytest.raises(LogError, match="log: exists"):
        write_log(tmp_path / "log", drive, "parquet")
    with pytest.raises(LogError, match=r"ends in \.bag"):
        write_log(tmp_path / "log1", drive, "rosbag1")
