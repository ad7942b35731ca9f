# SPDX-License-Identifier: MIT
"""Tables of poses whose first line names the columns are read by these names."""

import numpy as np
import pytest

from eval.files.trajectory_file import TumError, read_trajectory

STAMPS = 1.7e9 + 0.1 * np.arange(20)
HEADINGS = np.linspace(-3.0, 3.0, 20)
POSITIONS = np.column_stack([np.cos(HEADINGS), 2.0 * np.sin(HEADINGS), np.zeros(20)])
QUATERNIONS = np.column_stack([np.zeros(20), np.zeros(20), np.sin(HEADINGS / 2), np.cos(HEADINGS / 2)])
ODD = np.column_stack([np.cos(HEADINGS), np.sin(HEADINGS)])
"""Of other columns, which are no poses."""
NANOSECONDS = [round(stamp * 10) * 10**8 for stamp in STAMPS.tolist()]
ECHO = "%time,field.header.seq,field.header.stamp,field.header.frame_id"
POSE = "position.x,{0}position.y,{0}position.z,{0}orientation.x,{0}orientation.y,{0}orientation.z,{0}orientation.w"


def written(path, header, rows):
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def assert_read(path):
    trajectory, notes = read_trajectory(path)
    np.testing.assert_allclose(trajectory.stamps, STAMPS, atol=1e-6)
    np.testing.assert_allclose(trajectory.poses[:, :2], POSITIONS[:, :2], atol=1e-9)
    np.testing.assert_allclose(trajectory.poses[:, 2], HEADINGS, atol=1e-9)
    assert f"{path}: line 1 is read as a header that names the columns" in notes


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        (",timestamp,x,y,z,qx,qy,qz,qw", (range(20), STAMPS, POSITIONS, QUATERNIONS)),
        ("index,Timestamp,tx,ty,tz,qx,qy,qz,qw", (range(20), STAMPS, POSITIONS, QUATERNIONS)),
        ("t,qw,qx,qy,qz,x,y,z", (STAMPS, np.roll(QUATERNIONS, 1, axis=1), POSITIONS)),
        ('"time [s]","x [m]","y [m]","yaw [rad]"', (STAMPS, POSITIONS[:, :2], HEADINGS)),
        ("t_s,x_m,y_m,yaw_rad", (STAMPS, POSITIONS[:, :2], HEADINGS)),
        ("time_ms,x_mm,y_mm,yaw_deg", (STAMPS * 1e3, POSITIONS[:, :2] * 1e3, np.degrees(HEADINGS))),
        ("t (ms),x (cm),y (cm),theta (°)", (STAMPS * 1e3, POSITIONS[:, :2] * 1e2, np.degrees(HEADINGS))),
        ("stamp,robot_x,robot_y,robot_theta,vel_x,vel_y", (STAMPS, POSITIONS[:, :2], HEADINGS, ODD)),
        ("time,vel.x,vel.y,pos.x,pos.y,pos.z,rot.x,rot.y,rot.z,rot.w", (STAMPS, ODD, POSITIONS, QUATERNIONS)),
        (
            "__time,/odom/pose/pose/position/x,/odom/pose/pose/position/y,/odom/pose/pose/orientation/z,"
            "/odom/pose/pose/orientation/w",
            (STAMPS, POSITIONS[:, :2], QUATERNIONS[:, 2:]),
        ),
        (",x,y,z,qw,qx,qy,qz", (STAMPS, POSITIONS, np.roll(QUATERNIONS, 1, axis=1))),
        ("sim_time,x,y,yaw", (STAMPS, POSITIONS[:, :2], HEADINGS)),
        ("timestamp,x,y,z,roll_deg,pitch_deg,yaw_deg", (STAMPS, POSITIONS, 0.0 * ODD, np.degrees(HEADINGS))),
        ("speed,stamp,y,x,theta_deg", (HEADINGS, STAMPS, POSITIONS[:, [1, 0]], np.degrees(HEADINGS))),
    ],
)
def test_columns_are_taken_by_their_names(tmp_path, header, columns):
    assert_read(written(tmp_path / "t.csv", header, np.column_stack([*columns]).tolist()))


@pytest.mark.parametrize("below", ["field.pose.pose.", "field.pose."])
def test_what_rostopic_echo_writes_is_read(tmp_path, below):
    """Stamped by the message, not by the time at which it came."""
    header = f"{ECHO},{below}{POSE.format(below)},field.pose.covariance0"
    rows = [
        (t + 10**7, k, t, "map", *POSITIONS[k].tolist(), *QUATERNIONS[k].tolist(), 0.1)
        for k, t in enumerate(NANOSECONDS)
    ]
    assert_read(written(tmp_path / "t.csv", header, rows))


def test_seconds_and_nanoseconds_in_two_columns(tmp_path):
    header = f"Time,header.stamp.secs,header.stamp.nsecs,header.frame_id,pose.{POSE.format('pose.')}"
    rows = [
        (t / 1e9 + 5.0, t // 10**9, t % 10**9, "map", *POSITIONS[k].tolist(), *QUATERNIONS[k].tolist())
        for k, t in enumerate(NANOSECONDS)
    ]
    assert_read(written(tmp_path / "t.csv", header, rows))


@pytest.mark.parametrize(
    "date", ["2023-11-14 22:13:20.500000", "2023-11-14T22:13:20.500Z", "2023-11-14T23:13:20.5+01:00"]
)
def test_dates_with_a_time_of_day_are_stamps(tmp_path, date):
    trajectory, _ = read_trajectory(written(tmp_path / "t.csv", "timestamp,x,y,yaw", [[date, 1.0, 2.0, 0.5]]))
    assert trajectory.stamps[0] == pytest.approx(1_700_000_000.5, abs=1e-6)


def test_decimal_commas_between_semicolons_are_read(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("t;x;y;yaw\n0,5;1,25;-2,5;0,1\n")
    trajectory, _ = read_trajectory(path)
    assert (trajectory.stamps[0], *trajectory.poses[0]) == pytest.approx((0.5, 1.25, -2.5, 0.1))


def test_quoted_numbers_are_no_titles(tmp_path):
    rows = [[f'"{number}"' for number in row] for row in np.column_stack([STAMPS, POSITIONS[:, :2], HEADINGS]).tolist()]
    assert_read(written(tmp_path / "t.csv", '"t","x","y","yaw"', rows))


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("t,gt_x,gt_y,gt_yaw,est_x,est_y,est_yaw", "t.csv:1: the header names 2 poses"),
        ("t,x,y,yaw,x,y,yaw", "t.csv:1: the header names x twice"),
    ],
)
def test_two_poses_in_a_line_are_refused(tmp_path, header, message):
    with pytest.raises(TumError, match=message):
        read_trajectory(written(tmp_path / "t.csv", header, [[0.0] * 7]))


def test_a_robot_that_leans_by_its_roll_is_refused(tmp_path):
    with pytest.raises(TumError, match=r"t.csv:2: expected a pose in the plane .* leans by 28.6"):
        read_trajectory(written(tmp_path / "t.csv", "t,x,y,z,roll,pitch,yaw", [[0.0, 1.0, 2.0, 0.0, 0.5, 0.0, 0.3]]))


def test_a_line_with_other_cells_is_named(tmp_path):
    rows = np.column_stack([STAMPS, POSITIONS[:, :2], HEADINGS]).tolist()
    with pytest.raises(TumError, match=r"t.csv:4: expected 4 values as in the header, got 5"):
        read_trajectory(written(tmp_path / "t.csv", "t,x,y,yaw", [*rows[:2], [*rows[2], 1.0]]))
    with pytest.raises(TumError, match=r"t.csv:3: expected a number in the column t, got 'late'"):
        read_trajectory(written(tmp_path / "t.csv", "t,x,y,yaw", [rows[0], ["late", *rows[1][1:]]]))


def test_a_row_of_units_below_the_header_is_skipped(tmp_path):
    rows = np.column_stack([STAMPS, POSITIONS[:, :2], HEADINGS]).tolist()
    assert_read(written(tmp_path / "t.csv", "t,x,y,yaw", [["[s]", "[m]", "[m]", "[rad]"], *rows]))


TUM = np.column_stack([STAMPS, POSITIONS, QUATERNIONS])


def test_a_title_is_skipped(tmp_path):
    path = written(tmp_path / "t.tum", "estimate of 2024-05-01, run 3", TUM.tolist())
    trajectory, notes = read_trajectory(path)
    assert len(trajectory.stamps) == 20
    assert notes == (f"{path}: line 1 is read as a title",)


def test_a_column_that_counts_the_lines_is_left_out(tmp_path):
    path = tmp_path / "t.txt"
    np.savetxt(path, np.column_stack([np.arange(20), TUM]), fmt="%.9f")
    trajectory, notes = read_trajectory(path)
    np.testing.assert_allclose(trajectory.stamps, STAMPS, atol=1e-6)
    assert notes == (f"{path}: the first column counts the lines and is left out",)
    np.savetxt(path, np.column_stack([HEADINGS, TUM]), fmt="%.9f")
    with pytest.raises(TumError, match=r"t.txt:1: expected 8 numbers .* got 9"):
        read_trajectory(path)


def test_a_last_line_that_is_cut_is_left_out(tmp_path):
    path = tmp_path / "t.txt"
    np.savetxt(path, TUM, fmt="%.9f")
    path.write_text(path.read_text()[:-40])
    trajectory, notes = read_trajectory(path)
    assert len(trajectory.stamps) == 19
    assert notes == (f"{path}: line 20 is cut and left out",)


@pytest.mark.parametrize(
    ("line", "hint"),
    [("1 2 3 4 5 6 7", "roll pitch yaw"), (" ".join(["1,0"] * 8), "decimal commas"), ("1 " * 10, "got 10")],
)
def test_other_widths_are_named(tmp_path, line, hint):
    path = tmp_path / "t.txt"
    path.write_text(f"{line}\n")
    with pytest.raises(TumError, match=hint):
        read_trajectory(path)


@pytest.mark.parametrize(
    ("comment", "columns"),
    [
        ("# timestamp x y yaw", (STAMPS, POSITIONS[:, :2], HEADINGS)),
        ("#timestamp x y z qx qy qz qw id", (STAMPS, POSITIONS, QUATERNIONS, range(20))),
        ("# t qx qy qz qw x y z", (STAMPS, QUATERNIONS, POSITIONS)),
        ("# t x y z roll pitch yaw v", (STAMPS, POSITIONS, 0.0 * ODD, HEADINGS, HEADINGS)),
    ],
)
def test_a_comment_may_name_the_columns(tmp_path, comment, columns):
    """As `numpy.savetxt` writes a header, and rtabmap."""
    path = tmp_path / "t.txt"
    np.savetxt(path, np.column_stack([*columns]), fmt="%.12f", header=comment[1:])
    trajectory, notes = read_trajectory(path)
    np.testing.assert_allclose(trajectory.poses, np.column_stack([POSITIONS[:, :2], HEADINGS]), atol=1e-9)
    assert notes == (f"{path}: a comment is read as a header that names the columns",)


def test_a_comment_of_the_usual_columns_says_nothing_new(tmp_path):
    path = tmp_path / "t.tum"
    np.savetxt(path, np.column_stack([STAMPS, POSITIONS, QUATERNIONS]), header="timestamp tx ty tz qx qy qz qw")
    assert read_trajectory(path)[1] == ()


def test_lines_of_other_topics_are_left_out(tmp_path):
    """As PlotJuggler writes topics of several rates into one table."""
    rows = np.column_stack([STAMPS, POSITIONS[:, :2], HEADINGS, HEADINGS]).astype(str).tolist()
    table = [row for pose in rows for row in (pose, [pose[0], "", "", "", "1.5"])][:-1]
    trajectory, notes = read_trajectory(written(tmp_path / "t.csv", "__time,/odom/x,/odom/y,/odom/yaw,/imu", table))
    np.testing.assert_allclose(trajectory.poses[:, 2], HEADINGS, atol=1e-9)
    assert "19 of 39 lines hold no pose" in notes[1]


def test_the_header_of_a_joined_file_is_skipped(tmp_path):
    rows = np.column_stack([STAMPS, POSITIONS[:, :2], HEADINGS]).astype(str).tolist()
    header = "time,x,y,yaw"
    assert_read(written(tmp_path / "t.csv", header, [*rows[:10], header.split(","), *rows[10:]]))


def test_dates_with_slashes_are_stamps(tmp_path):
    rows = [[f"2023/11/14/22:13:{20 + 0.1 * k:09.6f}", *POSITIONS[k, :2], HEADINGS[k]] for k in range(20)]
    assert_read(written(tmp_path / "t.csv", "time,.pose.x,.pose.y,.pose.yaw", rows))
