# SPDX-License-Identifier: MIT
"""Read trajectories as other programs write them: TUM, EuRoC, and KITTI poses with stamps.

| format | numbers in a line |
|---|---|
| TUM | `t x y z qx qy qz qw` |
| EuRoC | `t x y z qw qx qy qz`, also with velocity and biases (17 numbers), stamps in nanoseconds |
| KITTI with stamps | `t` and the twelve numbers of `[R p]`, row by row |

A first line that names the columns, as in CSV files and in what `rostopic echo -p` and `bag_to_csv` write, says where
the stamp, the position and the quaternion (or yaw) stand, whatever else there is; also one behind `#`. What
`ros2 topic echo --csv` writes and tables of nine columns are known without names (`eval.files.unnamed_columns`). Lines
without a pose, as of a tracker that lost its target (NaN, zeros, empty cells), are left out.

Numbers are separated by spaces, tabs, commas or semicolons; `#` starts a comment. Quaternions with w first, camera
frames (x right, y down, z forward; of the poses, or of the camera alone, as in TUM's own files) and stamps in nano-,
micro- or milliseconds since 1970 are recognised, because any other reading would not be planar or not be of this time.
The plane is x, y: z is ignored.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eval.files.lines_without_pose import rows_with_pose
from eval.files.pose_lines import COLUMNS, PoseLines, wrong_width
from eval.files.trajectory_units import in_radians, in_seconds, with_zeros
from eval.files.unnamed_columns import NINE, eight_of_nine
from eval.trajectory.trajectory import Trajectory
from slam.se2 import wrap_angle

NORM_TOLERANCE = 1e-3
"""Largest deviation of a quaternion's length from 1 (files with 4 digits); such a quaternion is normalised."""
TILT_TOLERANCE = np.radians(1.0)
"""Largest tilt of a pose out of the plane [rad]; such a pose is projected onto the plane."""
_MAX_WITHOUT_POSE = 0.5
"""A file of which such a share of lines holds no pose is none of poses."""
_OF_CAMERA = "poses are read as those of a camera (z forward, y down) in a frame with z up"
_BINARY = (
    (b"\x1f\x8b", "a gzip file"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"\x93NUMPY", "a NumPy array"),
    (b"PAR1", "a Parquet table"),
    (b"SQLite format 3", "an SQLite data base"),
    (b"\x89MCAP", "an MCAP file"),
    (b"#ROSBAG", "a ROS 1 bag"),
    (b"\x89HDF", "an HDF5 file"),
)
"""First bytes of what is no text."""
_MIN_HEIGHT, _MIN_HEIGHT_SHARE = 0.5, 0.2
"""z adds a note if it varies by more than this [m], and by more than this share of the extent in the plane."""

Table = NDArray[np.float64]


class TumError(ValueError):
    """A file that is not a planar trajectory; the message names file, line and what was expected."""


def read_trajectory(path: str | os.PathLike[str]) -> tuple[Trajectory, tuple[str, ...]]:
    """Read a trajectory in file order, and notes on what was recognised; stamps may repeat and step backwards.

    Raises TumError for a wrong count of columns (naming the format that it looks like), what is not a finite number, a
    quaternion that is no unit (beyond `NORM_TOLERANCE`), a pose out of the plane (beyond `TILT_TOLERANCE`), or no pose
    at all; OSError as `open` does.
    """
    path = Path(path)
    _check_text(path)
    table, lines, notes = _read_table(path)
    stamps, positions = table[:, 0], table[:, 1:4]
    try:
        stamps, odd = in_seconds(stamps, positions[:, :2])
    except ValueError as error:
        raise TumError(f"{path}: {error}") from None
    notes += [f"{path}: {note}" for note in odd]
    if table.shape[1] == 13:
        positions, quaternions = _from_matrices(path, table, lines)
    else:
        quaternions = _unit(path, table[:, 4:8], lines, notes)
    positions, quaternions = _planar(path, positions, quaternions, lines, notes)
    extent = float(np.ptp(positions[:, :2], axis=0).max())
    if (height := float(np.ptp(positions[:, 2]))) > max(_MIN_HEIGHT, _MIN_HEIGHT_SHARE * extent):
        notes.append(f"{path}: z varies by {height:.2f} m and is ignored: is z up?")
    headings = wrap_angle(2.0 * np.arctan2(quaternions[:, 2], quaternions[:, 3]))
    return Trajectory(stamps, np.column_stack([positions[:, :2], headings])), tuple(notes)


def _read_table(path: Path) -> tuple[Table, list[int], list[str]]:
    """Return the numbers (n, 8, 13 or 17), the line of each row, and notes on a header and on what was left out."""
    found = PoseLines()
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, text in enumerate(file, start=1):
            try:
                found.take(number, text)
            except ValueError as error:
                if found.rows and not text.endswith("\n"):
                    found.notes.append(f"line {number} is cut and left out")
                    break
                raise TumError(f"{path}:{number}: {error}") from None
    if not found.rows:
        raise TumError(f"{path}: expected poses '{COLUMNS}', found none")
    notes = [f"{path}: {note}" for note in found.notes]
    table = np.array(found.rows)
    if table.shape[1] == NINE:
        eight = eight_of_nine(table)
        if eight is None:
            raise TumError(f"{path}:{found.numbers[0]}: {wrong_width(NINE)}")
        table, note = eight
        notes.append(f"{path}: {note}")
    elif (padded := with_zeros(found.stamps, table[:, 0])) is not None:
        table[:, 0] = padded
        notes.append(f"{path}: digits behind the point of the stamps are read as counts: 5.7 as 5.000000007")
    table, lines = _with_pose(path, table, found.numbers, found.empty, notes)
    if table.shape[1] == 7:
        table = _of_angles(path, table, notes, is_stated=found.states_angles)
    return table, lines, notes


def _with_pose(path: Path, table: Table, lines: list[int], empty: int, notes: list[str]) -> tuple[Table, list[int]]:
    """Return the rows that hold a pose, and their lines; a note on others.

    empty: lines that were left out before. Raises TumError where most rows hold none.
    """
    is_pose = rows_with_pose(table)
    without, count = int((~is_pose).sum()) + empty, len(table) + empty
    if without >= _MAX_WITHOUT_POSE * count:
        first = lines[int(np.argmin(is_pose))]
        raise TumError(
            f"{path}:{first}: expected finite numbers and a unit quaternion, got none in {without} of {count} lines"
        )
    if without:
        what = "hold no pose (NaN, zeros, empty cells, or the origin amid others)"
        notes.append(f"{path}: {without} of {count} lines {what} and are left out")
    return table[is_pose], [line for line, kept in zip(lines, is_pose.tolist(), strict=True) if kept]


def _check_text(path: Path) -> None:
    """Raise TumError where a file is no text, naming what it is."""
    with path.open("rb") as file:
        head = file.read(4096)
    kind = next((name for magic, name in _BINARY if head.startswith(magic)), None)
    if kind is None and b"\0" in head:
        kind = "text in UTF-16" if head[:2] in (b"\xff\xfe", b"\xfe\xff") else "a file with zero bytes"
    if kind is not None:
        raise TumError(f"{path}: expected a trajectory as text, got {kind}")


def _of_angles(path: Path, table: Table, notes: list[str], *, is_stated: bool) -> Table:
    """Return `t x y z qx qy qz qw` (n, 8) of `t x y z roll pitch yaw` (n, 7), with notes on their unit."""
    from scipy.spatial.transform import Rotation

    try:
        yaws, odd = in_radians(table[:, 6], table[:, 1:3], is_stated=is_stated)
    except ValueError as error:
        raise TumError(f"{path}: {error}") from None
    notes += [f"{path}: {note}" for note in odd]
    others = np.radians(table[:, 4:6]) if odd else table[:, 4:6]
    rotations = Rotation.from_euler("xyz", np.column_stack([others, yaws]))
    return np.column_stack([table[:, :4], rotations.as_quat()])


def _unit(path: Path, quaternions: Table, lines: list[int], notes: list[str]) -> Table:
    """Return normalised quaternions (n, 4); raise TumError for those that are no unit and not rounded ones either."""
    norm = np.linalg.norm(quaternions, axis=1)
    bad = np.flatnonzero(np.abs(norm - 1.0) > NORM_TOLERANCE)
    if len(bad):
        digits = next((d for d in (1, 2) if np.allclose(quaternions, np.round(quaternions, d), atol=1e-7)), 0)
        if not digits or np.abs(norm - 1.0).max() > 10.0**-digits:
            raise TumError(
                f"{path}:{lines[bad[0]]}: expected a unit quaternion qx qy qz qw, got one of length {norm[bad[0]]:.4g}"
            )
        error = np.degrees(2.0 * np.sqrt(0.5) * 10.0**-digits)
        count = "one digit" if digits == 1 else "two digits"
        notes.append(f"{path}: quaternions are rounded to {count}: headings are off by up to {error:.1f} degrees")
    unit: Table = quaternions / norm[:, None]
    return unit


def _from_matrices(path: Path, table: Table, lines: list[int]) -> tuple[Table, Table]:
    """Return positions (n, 3) and quaternions (n, 4), w last, of poses `[R p]` row by row."""
    from scipy.spatial.transform import Rotation

    matrices = table[:, 1:].reshape(-1, 3, 4)
    rotations = matrices[:, :, :3]
    error = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    if len(bad := np.flatnonzero((error > 10.0 * NORM_TOLERANCE) | (np.linalg.det(rotations) < 0.0))):
        raise TumError(f"{path}:{lines[bad[0]]}: expected a rotation matrix in 't [R p]', got one that is none")
    return matrices[:, :, 3], np.asarray(Rotation.from_matrix(rotations).as_quat())


def _planar(
    path: Path, positions: Table, quaternions: Table, lines: list[int], notes: list[str]
) -> tuple[Table, Table]:
    """Return positions (n, 3) and quaternions (n, 4), w last, in the reading in which all poses lie in the plane.

    w is first only where most poses would lean otherwise, and a frame is a camera's only where less movement is out of
    its plane. Of several planar readings (no pose turns) the one with the least movement out of the plane is taken.
    """
    w_first = quaternions[:, [1, 2, 3, 0]]
    readings = [
        (positions, quaternions, None),
        (positions, w_first, "quaternions are read with w first: qw qx qy qz"),
        (_from_camera(positions), _from_camera(quaternions), "poses are read in a camera frame: z forward, y down"),
        (
            _from_camera(positions),
            _from_camera(w_first),
            "poses are read in a camera frame (z forward, y down), quaternions with w first",
        ),
        (positions, _of_body(quaternions), _OF_CAMERA),
        (positions, _of_body(w_first), f"{_OF_CAMERA}, quaternions with w first"),
    ]
    tilts = [2.0 * np.arcsin(np.minimum(np.hypot(q[:, 0], q[:, 1]), 1.0)) for _, q, _ in readings]
    heights = [float(np.ptp(p[:, 2])) for p, _, _ in readings]
    most_lean = float(np.mean(tilts[0] > TILT_TOLERANCE)) > 0.5
    less_high = heights[2] < heights[0]
    allowed = (True, most_lean, less_high, most_lean and less_high, most_lean, most_lean)
    planar = [
        (round(heights[k], 1), k)
        for k in range(len(readings))
        if allowed[k] and float(tilts[k].max()) <= TILT_TOLERANCE
    ]
    if not planar:
        first = int(np.argmax(tilts[0] > TILT_TOLERANCE))
        raise TumError(
            f"{path}:{lines[first]}: expected a pose in the plane (qx = qy = 0), got one that leans by "
            f"{np.degrees(tilts[0][first]):.1f} degrees"
        )
    chosen, turned, note = readings[min(planar)[1]]
    if note is not None:
        notes.append(f"{path}: {note}")
    return chosen, turned


def _of_body(quaternions: Table) -> Table:
    """Return quaternions (n, 4), w last, of the body (x forward, z up) that carries a camera with these."""
    from scipy.spatial.transform import Rotation

    camera_in_body = Rotation.from_quat([-0.5, 0.5, -0.5, 0.5])
    return np.asarray((Rotation.from_quat(quaternions) * camera_in_body.inv()).as_quat())


def _from_camera(values: Table) -> Table:
    """Return vectors (n, 3), or quaternions (n, 4) with w last, of a camera frame (z forward, y down) with z up."""
    turned = np.column_stack([values[:, 2], -values[:, 0], -values[:, 1]])
    return np.column_stack([turned, values[:, 3]]) if values.shape[1] == 4 else turned
