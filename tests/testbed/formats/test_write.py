# SPDX-License-Identifier: MIT
"""All formats against each other: what both can hold comes through."""

import itertools
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.scan import Scan
from testbed.formats import Log, LogError
from testbed.formats.write import HOLDS, parts_of, write_log
from testbed.frame import Frame
from testbed.frame_table import FrameTable
from tests.testbed.recordings import (
    ANGLES,
    GRID,
    LOG_FORMATS,
    MOUNTS,
    SUFFIX,
    URDF,
    assert_same,
    through,
    two_lidar_drive,
)

KINDS = [log_format for log_format in LOG_FORMATS if log_format not in ("rosbag2-lean", "rosbag2-sqlite")]
"""One of each family."""

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
    return Log.from_frames(frames, path=Path("made"), format="made", truth_map=GRID, robot_urdf=URDF)


@pytest.mark.parametrize("log_format", LOG_FORMATS)
@settings(max_examples=5, deadline=None, derandomize=True)
@given(log=logs())
def test_a_format_keeps_what_it_can_hold(tmp_path_factory, log_format, log):
    folder = tmp_path_factory.mktemp("trip")
    assert_same(through(folder, log, log_format), log, (log_format,))
    shutil.rmtree(folder)


@pytest.mark.parametrize(("first", "second"), list(itertools.permutations(KINDS, 2)))
def test_a_round_trip_keeps_what_both_formats_hold(tmp_path, drive, first, second):
    assert_same(through(tmp_path, drive, first, second, first), drive, (first, second))


@pytest.fixture(scope="module")
def drive() -> Log:
    return two_lidar_drive()


@pytest.mark.parametrize("log_format", LOG_FORMATS)
def test_equal_logs_give_equal_bytes(tmp_path, drive, log_format):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_log(tmp_path / folder / f"log{SUFFIX.get(log_format, '')}", drive, log_format)
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert files
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_the_true_map_alone_is_written_for_map_server(tmp_path, drive):
    from eval.files.map_server import read_map

    write_log(tmp_path / "map.yaml", drive, "map_server")
    np.testing.assert_array_equal(read_map(tmp_path / "map.yaml").probability, GRID.probability)
    bare = Log.from_frames(drive.frames, path=Path("bare"), format="made")
    with pytest.raises(LogError, match="bare: holds no true map"):
        write_log(tmp_path / "other.yaml", bare, "map_server")


def test_parts_of_a_log(drive):
    assert parts_of(drive) == HOLDS["parquet"] - {"lidar names"}  # CARMEN has these two names
    assert parts_of(Log.from_frames([Frame(stamp=0.0, odometry=np.zeros(3))], path=Path("p"), format="f")) == {
        "odometry"
    }


def test_what_is_there_is_not_overwritten(tmp_path, drive):
    (tmp_path / "log").mkdir()
    with pytest.raises(LogError, match="log: exists"):
        write_log(tmp_path / "log", drive, "parquet")
    with pytest.raises(LogError, match=r"ends in \.bag"):
        write_log(tmp_path / "log1", drive, "rosbag1")


@pytest.mark.parametrize(
    ("log_format", "change", "complaint"),
    [
        ("rosbag2", {"angles": ANGLES**3}, "frame 1: LaserScan needs beams evenly spaced"),
        ("rosbag1", {"mount": (1.0, 1.0, 0.0)}, "scans of one lidar (laser) mounted at different places"),
        ("carmen", {"angles": ANGLES**3}, "frame 1: ROBOTLASER1 needs evenly spaced beams"),
        ("carmen-flaser", {"mount": (0.0, 1.0, 0.0)}, "FLASER cannot hold a lidar mounted at"),
    ],
)
def test_data_a_format_cannot_hold_is_refused_and_leaves_no_file(tmp_path, drive, log_format, change, complaint):
    frames = list(drive.frames)
    frames[1] = replace(frames[1], scan=replace(frames[1].scan, **change))
    out = tmp_path / f"out{SUFFIX.get(log_format, '')}"
    with pytest.raises(LogError) as error:
        write_log(out, replace(drive, table=FrameTable.from_frames(frames)), log_format)
    assert str(error.value).startswith(f"{out}: {complaint}")
    assert list(tmp_path.iterdir()) == []


def test_the_table_in_the_docs_is_true():
    lines = (Path(__file__).parents[3] / "docs" / "formats.md").read_text().splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith("| | odometry"))
    parts = [cell.strip() for cell in lines[begin].split("|")[2:-1]]
    documented = {}
    for line in itertools.takewhile(lambda line: line.startswith("|"), lines[begin + 2 :]):
        name, *cells = [cell.strip() for cell in line.split("|")[1:-1]]
        documented[name.strip("`")] = {part for part, cell in zip(parts, cells, strict=True) if cell == "x"}
    assert documented == HOLDS
