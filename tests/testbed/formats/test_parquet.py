# SPDX-License-Identifier: MIT
"""Tables whose numbers are nonsense: the row and the column are named at reading."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from testbed.formats import LogError, open_log
from testbed.formats.write import write_log
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
