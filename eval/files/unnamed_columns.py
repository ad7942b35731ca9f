# SPDX-License-Identifier: MIT
"""Columns of tables of poses that no line names, known by what stands in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NINE = 9
"""Columns of a TUM line and one more."""
_POSE = 7
"""Numbers of a position and a quaternion."""
_NANO = 1e-9
_SINCE_1970 = 1e8
"""Larger whole numbers are seconds since 1970, no count of lines."""
_UNIT_TOLERANCE = 1e-3

Table = NDArray[np.float64]


def of_topic_echo(line: str) -> list[float] | None:
    """Return `t x y z qx qy qz qw` of a line of `ros2 topic echo --csv`; None where it is none.

    All messages with a header and a pose or transform begin alike: seconds, nanoseconds, one or two frames, position,
    quaternion with w last (PoseStamped, PoseWithCovarianceStamped, Odometry, TransformStamped).
    """
    cells = [cell.strip() for cell in line.split(",")]
    if len(cells) < 3 + _POSE or not (cells[0].isdigit() and cells[1].isdigit()) or _number(cells[2]) is not None:
        return None
    begin = 3 if _number(cells[3]) is not None else 4
    pose = [number for cell in cells[begin : begin + _POSE] if (number := _number(cell)) is not None]
    return [int(cells[0]) + _NANO * int(cells[1]), *pose] if len(pose) == _POSE else None


def eight_of_nine(table: Table) -> tuple[Table, str] | None:
    """Return `t x y z qx qy qz qw` (n, 8) of a table (n, 9), and a note; None where it shows no such columns.

    Known are seconds and nanoseconds in two columns, the number of the line in front, as tables of pandas have it, and
    a whole number behind the pose, as the identifiers of rtabmap.
    """
    first, second, last = table[:, 0], table[:, 1], table[:, -1]
    counts = bool((np.diff(first) == 1.0).all())
    nanoseconds = _is_whole(second) and second.min() >= 0.0 and second.max() < 1.0 / _NANO
    if _is_whole(first) and nanoseconds and (not counts or first.min() > _SINCE_1970):
        stamps = first + _NANO * second
        return np.column_stack([stamps, table[:, 2:]]), "the first two columns are read as seconds and nanoseconds"
    if counts and first.min() < _SINCE_1970:
        return table[:, 1:], "the first column counts the lines and is left out"
    unit = np.abs(np.linalg.norm(table[:, 4:8], axis=1) - 1.0) < _UNIT_TOLERANCE
    if _is_whole(last) and unit.all():
        return table[:, :-1], "the last column holds whole numbers and is left out"
    return None


def _is_whole(numbers: Table) -> bool:
    return bool((np.isfinite(numbers) & (numbers == np.round(numbers))).all())


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
