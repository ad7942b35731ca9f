# SPDX-License-Identifier: MIT
"""TUM files: what is written is read back bit by bit; every broken line is named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eval.files.tum import TumError, read_tum, write_tum
from eval.trajectory.trajectory import Trajectory
from slam.se2 import wrap_angle

number = st.floats(-1e6, 1e6, allow_nan=False, width=64)


@given(st.lists(st.tuples(st.floats(-1e10, 1e10), number, number, st.floats(-3.1, 3.1)), min_size=1, max_size=20))
@settings(deadline=None)
def test_positions_and_stamps_come_back_bit_by_bit_in_file_order(tmp_path_factory, rows):
    table = np.array(rows)
    path = tmp_path_factory.mktemp("tum") / "t.tum"
    write_tum(path, Trajectory(table[:, 0], table[:, 1:]))
    back = read_tum(path)
    np.testing.assert_array_equal(back.stamps, table[:, 0])
    np.testing.assert_array_equal(back.poses[:, :2], table[:, 1:3])
    np.testing.assert_allclose(wrap_angle(back.poses[:, 2] - table[:, 3]), 0.0, atol=1e-15)
    assert [p.name for p in path.parent.iterdir()] == ["t.tum"]  # nothing left aside


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("1 2 3 0 0 0 0", "got 7"),
        ("1 2 3 0 0 0 0 x", "expected 8 numbers, got '1 2 3"),
        ("1 nan 3 0 0 0 0 1", "finite"),
        ("inf 2 3 0 0 0 0 1", "finite"),
        ("1 2 3 0 0 0 0 2", "unit quaternion"),
        ("1 2 3 0 0 0 0 0", "unit quaternion"),
        ("1 2 3 0 0.1736 0 0 0.9848", "leans by 20.0 degrees"),
    ],
)
def test_a_broken_line_is_named_with_what_was_expected(tmp_path, line, expected):
    path = tmp_path / "broken.tum"
    path.write_text(f"# t x y z qx qy qz qw\n0 0 0 0 0 0 0 1\n{line}\n")
    with pytest.raises(TumError, match=r"broken\.tum:3: ") as caught:
        read_tum(path)
    assert expected in str(caught.value)


def test_an_empty_file_is_an_error(tmp_path):
    path = tmp_path / "empty.tum"
    path.write_text("# nothing\n")
    with pytest.raises(TumError, match="found none"):
        read_tum(path)


def test_a_quaternion_of_few_digits_and_its_negative_are_read(tmp_path):
    path = tmp_path / "t.tum"
    path.write_text("5 1 2 9 0 0 0.7071 0.7071\n4 1 2 9 0 0 -0.7071 -0.7071  # the same turn, an earlier stamp\n")
    back = read_tum(path)
    np.testing.assert_array_equal(back.stamps, [5.0, 4.0])
    np.testing.assert_allclose(wrap_angle(back.poses[:, 2]), np.pi / 2, atol=1e-12)


@pytest.mark.parametrize(
    ("stamps", "poses"),
    [([], np.zeros((0, 3))), ([1.0], np.zeros((2, 3))), ([np.nan], np.zeros((1, 3))), ([0.0], [[0.0, np.inf, 0.0]])],
)
def test_a_trajectory_refuses_what_is_none(stamps, poses):
    with pytest.raises(ValueError, match="a trajectory takes"):
        Trajectory(np.asarray(stamps), np.asarray(poses))


def test_a_trajectory_copies_its_arrays():
    stamps, poses = np.arange(2.0), np.zeros((2, 3))
    trajectory = Trajectory(stamps, poses)
    poses[0, 0] = 7.0
    assert trajectory.poses[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.poses[0, 0] = 1.0
