# SPDX-License-Identifier: MIT
"""Units that the numbers of a trajectory show: of its stamps by the robot's speed, of its headings by its path."""

import numpy as np
import pytest

from eval.files.trajectory_file import TumError, read_trajectory

STAMPS = np.arange(300) * 0.1
ANGLES = 3.0 * np.pi * STAMPS / STAMPS[-1]
PLACES = np.column_stack([3.0 * np.sin(ANGLES), 3.0 - 3.0 * np.cos(ANGLES)])
"""One and a half turns of a circle, counter-clockwise, at 0.9 m/s; headings are `ANGLES`."""


def written(path, header, *columns):
    rows = [",".join(f"{number:.9f}" for number in row) for row in np.column_stack(columns).tolist()]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def tum(path, stamps):
    half = 0.5 * ANGLES
    return written(path, "# t x y z qx qy qz qw", stamps, PLACES, np.zeros((300, 3)), np.sin(half), np.cos(half))


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_stamps_from_zero_are_read_in_the_unit_of_a_robots_speed(tmp_path, factor, unit):
    trajectory, notes = read_trajectory(tum(tmp_path / "t.tum", STAMPS * factor))
    np.testing.assert_allclose(trajectory.stamps, STAMPS, atol=1e-6)
    assert f"stamps are read as {unit}: in seconds the robot would make" in notes[0]


@pytest.mark.parametrize("factor", [1.0, 20.0, 100.0])
def test_slow_robots_and_rare_poses_are_left_alone(tmp_path, factor):
    trajectory, notes = read_trajectory(tum(tmp_path / "t.tum", STAMPS * factor))
    np.testing.assert_allclose(trajectory.stamps, STAMPS * factor, atol=1e-6)
    assert notes == ()


def test_stamps_of_no_robots_speed_are_questioned(tmp_path):
    _, notes = read_trajectory(tum(tmp_path / "t.tum", STAMPS * 1e11))
    assert "poses are 1e+10 s apart: are the stamps in seconds?" in notes[0]


@pytest.mark.parametrize("stamps", [1.7e9 + 0.0 * STAMPS, np.floor(STAMPS)])
def test_rounded_stamps_are_refused(tmp_path, stamps):
    with pytest.raises(TumError, match=r"t\.tum: \d+ of 300 poses have the stamp of the one before: rounded stamps"):
        read_trajectory(tum(tmp_path / "t.tum", stamps))


def test_stamps_rounded_a_little_add_a_note(tmp_path):
    _, notes = read_trajectory(tum(tmp_path / "t.tum", np.floor(STAMPS / 0.15) * 0.15))
    assert "were the stamps rounded?" in notes[0]


def test_a_robot_that_stands_may_repeat_its_stamp(tmp_path):
    path = tmp_path / "t.tum"
    path.write_text("5 1 2 0 0 0 0 1\n" * 20)
    assert read_trajectory(path)[1] == ()


def test_stamps_that_count_the_poses_are_questioned(tmp_path):
    _, notes = read_trajectory(tum(tmp_path / "t.tum", np.arange(300.0)))
    assert "the stamps count the poses" in notes[0]


def table(tmp_path, yaws, places=PLACES, name="yaw"):
    return written(tmp_path / "t.csv", f"t,x,y,{name}", STAMPS, places, yaws)


@pytest.mark.parametrize("backwards", [0.0, np.pi])
def test_degrees_show_in_the_direction_of_travel(tmp_path, backwards):
    trajectory, notes = read_trajectory(table(tmp_path, np.degrees(ANGLES + backwards) % 360.0))
    off = np.exp(1j * (trajectory.poses[:, 2] - ANGLES - backwards))
    np.testing.assert_allclose(off, 1.0, atol=1e-6)
    assert notes[-1].endswith("headings are read as degrees")


def test_radians_beyond_a_turn_stay_radians(tmp_path):
    trajectory, notes = read_trajectory(table(tmp_path, ANGLES))
    np.testing.assert_allclose(np.exp(1j * (trajectory.poses[:, 2] - ANGLES)), 1.0, atol=1e-6)
    assert len(notes) == 1  # the header


def test_a_path_that_does_not_tell_the_unit_is_refused(tmp_path):
    with pytest.raises(
        TumError, match=r"t\.csv: headings of up to \d+ may be degrees or radians: expected a column yaw_deg"
    ):
        read_trajectory(table(tmp_path, np.degrees(ANGLES), places=0.0 * PLACES))


@pytest.mark.parametrize("name", ["heading", "heading_deg"])
def test_the_headings_of_a_compass_are_refused(tmp_path, name):
    with pytest.raises(TumError, match=r"t\.csv: headings turn clockwise"):
        read_trajectory(table(tmp_path, np.degrees(0.5 * np.pi - ANGLES) % 360.0, name=name))


@pytest.mark.parametrize(
    ("content", "kind"),
    [(b"\x1f\x8b\x08", "a gzip file"), (b"\x93NUMPY", "a NumPy array"), (b"a\0b", "a file with zero bytes"),
     (b"\xff\xfe1\0", "text in UTF-16"), (b"VERTEX_SE2 0 1 2 3\n", "g2o"), (b"ODOM 1 2 3\n", "CARMEN")],
)  # fmt: skip
def test_other_formats_are_named(tmp_path, content, kind):
    (tmp_path / "t.tum").write_bytes(content)
    with pytest.raises(TumError, match=kind):
        read_trajectory(tmp_path / "t.tum")
