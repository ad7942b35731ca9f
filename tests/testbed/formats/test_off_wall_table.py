# SPDX-License-Identifier: MIT
"""Tables of beams that did not end on a wall: written and read back, and refused with the line where they are wrong."""

import numpy as np
import pytest

from testbed.formats import LogError
from testbed.formats.off_wall import read_off_wall, write_off_wall
from testbed.simulation.robot.off_wall import OffWallBeams

HEAD = "stamp,x,y,direction,range\n"


def test_tables_come_back_to_a_tenth_of_a_millimetre(tmp_path):
    beams = OffWallBeams(
        stamps=np.array([0.0, 1.25, 1.25]),
        origins=np.array([[1.23456, -2.0], [0.0, 0.0], [1e3, 0.1]]),
        directions=np.array([-3.1, 0.0, 7.654321]),
        ranges=np.array([np.inf, np.nan, 3.33333]),
    )
    write_off_wall(tmp_path / "off_wall.csv", beams)
    found = read_off_wall(tmp_path / "off_wall.csv")
    assert np.array_equal(found.stamps, beams.stamps)
    assert np.allclose(found.origins, beams.origins, rtol=0, atol=0.6e-4)
    assert np.allclose(found.directions, beams.directions, rtol=0, atol=0.6e-6)
    assert np.allclose(found.ranges, beams.ranges, rtol=0, atol=0.6e-4, equal_nan=True)


def test_a_table_may_have_no_rows(tmp_path):
    write_off_wall(tmp_path / "none.csv", read_off_wall(write(tmp_path, HEAD)))
    assert len(read_off_wall(tmp_path / "none.csv").stamps) == 0


def write(folder, content):
    table = folder / "off_wall.csv"
    table.write_text(content)
    return table


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("stamp,x\n0,1\n", ":1: expected the columns stamp,x,y,direction,range, got stamp,x"),
        (HEAD + "0,0,0,0\n", ":2: expected 5 values, got 4"),
        (HEAD + "0,0,0,0,far\n", ":2: expected numbers, got 0,0,0,0,far"),
        (HEAD + "0,0,nan,0,1\n", ":2: expected finite numbers before the range"),
        (HEAD + "0,0,0,0,-1\n", ":2: range -1, expected a positive one, inf or nan"),
        (HEAD + "2,0,0,0,1\n1,0,0,0,1\n", ":3: stamp 1 after 2"),
    ],
    ids=["columns", "values", "words", "nan", "negative", "order"],
)
def test_bad_tables_are_named_with_the_line(tmp_path, content, complaint):
    table = write(tmp_path, content)
    with pytest.raises(LogError, match=complaint) as error:
        read_off_wall(table)
    assert str(error.value).startswith(str(table))
    assert str(error.value).count(str(table)) == 1


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(LogError, match=r"gone\.csv: No such file"):
        read_off_wall(tmp_path / "gone.csv")
