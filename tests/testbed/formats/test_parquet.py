# SPDX-License-Identifier: MIT
"""Tables whose numbers are nonsense: the row and the column are named at reading."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from slam.scan import Scan
from testbed.formats import Log, LogError, open_log
from testbed.formats.head import LogHead
from testbed.formats.parquet import GROUP_ROWS, write_parquet
from testbed.formats.write import write_log
from testbed.frame import Frame
from tests.testbed.recordings import two_lidar_drive


@pytest.fixture
def table(tmp_path):
    write_log(tmp_path / "drive.parquet", two_lidar_drive(), "parquet")
    return pq.read_table(next((tmp_path / "drive.parquet").glob("*.parquet")))


def changed(table, name, row, value):
    """The table with one value of a column replaced."""
    values = table[name].to_pylist()
    values[row] = value
    place = table.schema.get_field_index(name)
    return table.set_column(place, table.schema.field(name), pa.array(values, table.schema.field(name).type))


def first_scan(table) -> int:
    return next(row for row, ranges in enumerate(table["ranges"].to_pylist()) if ranges is not None)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_angles_that_are_not_finite_are_named_with_their_row(tmp_path, table, value):
    row = first_scan(table)
    angles = table["angles"].to_pylist()[row]
    pq.write_table(changed(table, "angles", row, [value, *angles[1:]]), tmp_path / "bad.parquet")
    with pytest.raises(LogError, match=rf"bad\.parquet: row {row}: angles: expected finite numbers"):
        open_log(tmp_path / "bad.parquet")


def test_a_stamp_that_is_no_time_is_named_with_its_row(tmp_path, table):
    pq.write_table(changed(table, "stamp", 3, 1e12), tmp_path / "bad.parquet")
    with pytest.raises(LogError, match=r"bad\.parquet: row 3: a stamp that is no time"):
        open_log(tmp_path / "bad.parquet")


def test_stamps_in_nanoseconds_are_read_as_seconds(tmp_path, table):
    place = table.schema.get_field_index("stamp")
    stamps = np.asarray(table["stamp"]) + 1.6e9
    pq.write_table(
        table.set_column(place, table.schema.field("stamp"), pa.array(stamps * 1e9)), tmp_path / "nano.parquet"
    )
    log = open_log(tmp_path / "nano.parquet")
    assert log.table.stamps == pytest.approx(stamps, abs=1e-5)
    assert "stamps are in nanoseconds; they are read as seconds" in log.notes


def test_rows_are_written_in_large_groups_and_read_the_same(tmp_path):
    """From blocks of any size, with one beam pattern that all scans share, and with several."""
    wide, narrow = np.linspace(-1.0, 1.0, 3), np.array([0.5, 0.75])
    angles = [wide] * 1200 + [wide, narrow] * 200
    n = len(angles)
    frames = [
        Frame(
            stamp=0.1 * k,
            odometry=np.array([k, 0.0, 0.0]),
            scan=Scan(ranges=k + np.arange(len(angles[k])), angles=angles[k], range_max=1e9),
        )
        for k in range(n)
    ]
    log = Log.from_frames(frames, path=tmp_path / "drive", format="simulation")
    write_parquet(tmp_path / "drive", log.table.blocks(), LogHead.of(log))
    written = pq.ParquetFile(tmp_path / "drive" / "frames.parquet")
    groups = [written.metadata.row_group(k).num_rows for k in range(written.num_row_groups)]
    assert groups == [GROUP_ROWS, n - GROUP_ROWS]
    read = open_log(tmp_path / "drive").frames
    assert len(read) == n
    for frame, back in zip(frames, read, strict=True):
        np.testing.assert_array_equal(back.scan.ranges, frame.scan.ranges)
        np.testing.assert_array_equal(back.scan.angles, frame.scan.angles)
