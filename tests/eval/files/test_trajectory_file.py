# SPDX-License-Identifier: MIT
"""Trajectories as other programs write them: read right and said so, or refused by the name of their format."""

import numpy as np
import pytest

from eval.files.trajectory_file import TumError, read_trajectory
from slam.se2 import wrap_angle
from tests.eval.helpers import random_walk

TRUTH = random_walk(200, 7)
T, HALF = TRUTH.stamps, 0.5 * TRUTH.poses[:, 2]
X, Y = TRUTH.poses[:, 0], TRUTH.poses[:, 1]
ZERO, SIN, COS = np.zeros(len(T)), np.sin(HALF), np.cos(HALF)
PLAIN = np.column_stack([T, X, Y, ZERO, ZERO, ZERO, SIN, COS])
W_FIRST = PLAIN[:, [0, 1, 2, 3, 7, 4, 5, 6]]
CAMERA = np.column_stack([T, -Y, ZERO, X, ZERO, -SIN, ZERO, COS])


def matrices(table):
    """`t [R p]` of a table in the plane."""
    heading = 2.0 * np.arctan2(table[:, 6], table[:, 7])
    cos, sin, zero, one = np.cos(heading), np.sin(heading), np.zeros(len(table)), np.ones(len(table))
    return np.column_stack(
        [table[:, 0], cos, -sin, zero, table[:, 1], sin, cos, zero, table[:, 2], zero, zero, one, zero]
    )


def read(folder, table, *, header="", separator=" ", digits=12):
    path = folder / "t.txt"
    body = "\n".join(separator.join(f"{value:.{digits}f}" for value in row) for row in table)
    path.write_text(f"{header}\n{body}\n")
    return read_trajectory(path)


def check(found, *notes, heading=1e-9):
    trajectory, said = found
    np.testing.assert_allclose(trajectory.stamps, T, atol=1e-6)
    np.testing.assert_allclose(trajectory.poses[:, :2], TRUTH.poses[:, :2], atol=1e-9)
    assert np.abs(wrap_angle(trajectory.poses[:, 2] - TRUTH.poses[:, 2])).max() < heading
    assert len(said) == len(notes)
    for sentence, note in zip(said, notes, strict=True):
        assert note in sentence
        assert "t.txt: " in sentence


@pytest.mark.parametrize("separator", [" ", "\t", ",", ", ", ";"])
def test_every_separator_is_read(tmp_path, separator):
    check(read(tmp_path, PLAIN, separator=separator))


@pytest.mark.parametrize("header", ["# t x y z", "timestamp,tx,ty,tz,qx,qy,qz,qw", "t x y z qx qy qz qw"])
def test_a_header_is_skipped(tmp_path, header):
    check(read(tmp_path, PLAIN, header=header), *([] if header.startswith("#") else ["line 1 is read as a header"]))


def test_w_first_is_recognised(tmp_path):
    check(read(tmp_path, W_FIRST), "w first")


def test_a_camera_frame_is_recognised(tmp_path):
    check(read(tmp_path, CAMERA), "camera frame")


def test_a_camera_frame_with_w_first_is_recognised(tmp_path):
    check(read(tmp_path, CAMERA[:, [0, 1, 2, 3, 7, 4, 5, 6]]), "camera frame (z forward, y down), quaternions with w")


@pytest.mark.parametrize("w_first", [False, True])
def test_a_camera_in_a_frame_with_z_up_is_recognised(tmp_path, w_first):
    """As in TUM's own files: the product of (0, 0, sin, cos) with the camera's (-1, 1, -1, 1) / 2."""
    turned = 0.5 * np.column_stack([-COS - SIN, COS - SIN, SIN - COS, SIN + COS])
    table = np.column_stack([T, X, Y, ZERO, turned])[:, [0, 1, 2, 3, 7, 4, 5, 6] if w_first else slice(None)]
    notes = "a camera (z forward, y down) in a frame with z up" + (", quaternions with w first" if w_first else "")
    check(read(tmp_path, table), notes)


def test_a_byte_order_mark_is_skipped(tmp_path):
    check(read(tmp_path, PLAIN, header="\ufeff# t x y z"))


def test_a_camera_that_drives_ahead_is_recognised(tmp_path):
    ahead = np.column_stack([T, ZERO, ZERO, 0.1 * T, ZERO, ZERO, ZERO, ZERO + 1.0])
    trajectory, notes = read(tmp_path, ahead)
    np.testing.assert_allclose(trajectory.poses, np.column_stack([0.1 * T, ZERO, ZERO]), atol=1e-9)
    assert "camera frame" in notes[0]


@pytest.mark.parametrize("columns", [8, 17])
def test_euroc_is_read(tmp_path, columns):
    start = 1.4e9
    shifted = np.column_stack([W_FIRST, np.full((len(T), columns - 8), 0.5)])
    path = tmp_path / "data.csv"
    rows = [
        f"{round((start + t) * 1e9)}," + ",".join(map(repr, row[1:].tolist()))
        for t, row in zip(T, shifted, strict=True)
    ]
    path.write_text("#timestamp [ns], p_RS_R_x [m], …\n" + "\n".join(rows))
    trajectory, notes = read_trajectory(path)
    np.testing.assert_allclose(trajectory.stamps - start, T, atol=1e-6)
    np.testing.assert_allclose(trajectory.poses[:, :2], TRUTH.poses[:, :2])
    assert [("nanoseconds" in notes[0]), ("w first" in notes[1])] == [True, True]


@pytest.mark.parametrize(("factor", "unit"), [(1e9, "nanoseconds"), (1e6, "microseconds"), (1e3, "milliseconds")])
def test_stamps_since_1970_have_their_unit_recognised(tmp_path, factor, unit):
    table = PLAIN.copy()
    table[:, 0] = (1.7e9 + T) * factor
    trajectory, notes = read(tmp_path, table)
    np.testing.assert_allclose(trajectory.stamps - 1.7e9, T, atol=1e-5)
    assert unit in notes[0]


def test_kitti_poses_with_stamps_are_read_and_without_are_named(tmp_path):
    check(read(tmp_path, matrices(PLAIN)), heading=1e-6)
    with pytest.raises(TumError, match=r"t\.txt:2: .*got 12, which looks like KITTI poses.*paste -d' ' times\.txt"):
        read(tmp_path, matrices(PLAIN)[:, 1:])
    mirrored = matrices(PLAIN)
    mirrored[5, 11] = -1.0
    with pytest.raises(TumError, match=r"t\.txt:7: expected a rotation matrix"):
        read(tmp_path, mirrored)


@pytest.mark.parametrize(("digits", "bound"), [(2, 0.8), (1, 8.1)])
def test_rounded_quaternions_are_read_with_the_error_of_rounding(tmp_path, digits, bound):
    table = np.column_stack([PLAIN[:, :4], np.round(PLAIN[:, 4:], digits)])
    trajectory, notes = read(tmp_path, table, digits=9)
    error = np.degrees(np.abs(wrap_angle(trajectory.poses[:, 2] - TRUTH.poses[:, 2]))).max()
    assert 0.3 * bound < error < bound + 0.05
    assert f"headings are off by up to {bound} degrees" in notes[0]


def test_other_planar_formats_are_named(tmp_path):
    with pytest.raises(TumError, match=r"got 4, which looks like 't x y yaw'"):
        read(tmp_path, np.column_stack([T, X, Y, HALF]))
    with pytest.raises(TumError, match=r"got 3, which looks like 'x y yaw' without stamps"):
        read(tmp_path, np.column_stack([X, Y, HALF]))


def test_a_single_pose_that_leans_is_no_camera(tmp_path):
    table = PLAIN.copy()
    table[20, 4:] = [0.0, 0.5, 0.0, np.sqrt(0.75)]
    with pytest.raises(TumError, match=r"t\.txt:22: .*leans by 60\.0 degrees"):
        read(tmp_path, table)


def test_movement_out_of_the_plane_is_said(tmp_path):
    table = PLAIN.copy()
    table[:, 3] = np.linspace(0.0, 30.0, len(T))
    check(read(tmp_path, table), "z varies by 30.00 m and is ignored")
