# SPDX-License-Identifier: MIT
"""Columns of a table of poses that its first line names, as CSV files, `rostopic echo -p` and PlotJuggler do.

Names are compared in small letters, without their unit, and with one sign between words: `/odom/pose/position/x`,
`pose_position_x` and `pose.position.x` are the same. Where no usual name is there, columns whose names end alike count:
`robot_x`, `robot_y`, `robot_yaw`.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TypeVar

_STAMPS = (
    ("header.stamp.secs", "header.stamp.nsecs"),
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("header.stamp.sec", "header.stamp.nsec"),
    ("stamp.secs", "stamp.nsecs"),
    ("stamp.sec", "stamp.nanosec"),
    ("stamp.sec", "stamp.nsec"),
    ("secs", "nsecs"),
    ("sec", "nanosec"),
    ("header.stamp",),
    ("timestamp",),
    ("stamp",),
    ("time",),
    ("t",),
)
"""Names of a stamp, the best first; of two columns the second counts nanoseconds."""
_POSITIONS = ("pose.position.{}", "position.{}", "pos.{}", "p.rs.r.{}", "p.{}", "p{}", "t{}", "{}")
_ROTATIONS = ("pose.orientation.{}", "orientation.{}", "quat.{}", "q.rs.{}", "q.{}", "q{}")
_YAWS = ("yaw", "theta", "heading")
_NO_POSE = {
    *("linear", "angular", "twist", "vel", "velocity", "speed", "v", "acc", "accel", "acceleration", "gyro", "omega"),
    *("bias", "b", "cov", "covariance", "std", "sigma", "var", "err", "error", "cmd", "goal", "target"),
    *("orientation", "rotation", "rot", "quat", "q"),
}
"""Words of names whose x and y are no position."""
_UNITS = {
    "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9,
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metres": 1.0, "cm": 1e-2, "mm": 1e-3,
    "rad": 1.0, "radians": 1.0, "deg": math.radians(1.0), "degree": math.radians(1.0), "degrees": math.radians(1.0),
    "°": math.radians(1.0),
}  # fmt: skip
"""Units that a name may state, in s, m or rad."""
_DATE_WITH_SLASHES = re.compile(r"^(\d{4})/(\d{2})/(\d{2})[/ T]")
"""Year, month and day of a date as rosbag2csv writes it."""
_IN_BRACKETS = re.compile(r"\s*[\[(]([^\])]*)[\])]\s*$")

Columns = tuple[int, ...]
Found = TypeVar("Found")


@dataclass(frozen=True)
class NamedColumns:
    """Where a line holds what of a pose."""

    separator: str | None
    """Between two cells; None = blanks."""
    names: tuple[str, ...]
    """Of all columns, as the file has them."""
    units: tuple[float, ...]
    """Of all columns [s], [m] or [rad]."""
    stamp: Columns
    position: Columns
    """Of x, y and, where there is one, z."""
    rotation: Columns
    """Of the quaternion x, y, z, w, of z and w, of roll, pitch and yaw, or of the yaw alone."""

    def pose(self, line: str) -> list[float]:
        """Return `t x y z qx qy qz qw`, or `t x y z roll pitch yaw` where those are named.

        Raises ValueError where a line has other cells, or no numbers in those that count.
        """
        cells = self._cells(line)
        if len(cells) != len(self.names):
            raise ValueError(f"expected {len(self.names)} values as in the header, got {len(cells)}")
        stamp = sum(self._time(cells, k) * unit for k, unit in zip(self.stamp, (1.0, 1e-9), strict=False))
        x, y, *z = (self._number(cells, k) for k in self.position)
        rotation = [self._number(cells, k) for k in self.rotation]
        flat = {1: [0.0, 0.0], 2: [0.0, 0.0]}.get(len(rotation), [])
        return [stamp, x, y, *(z or [0.0]), *flat, *rotation]

    def is_header(self, line: str) -> bool:
        """Whether a line names the columns once more."""
        return tuple(_cells(line, self.separator)) == self.names

    def is_empty(self, line: str) -> bool:
        """Whether a line has no pose: all its cells are empty, as where another topic of a table sent a message."""
        cells = self._cells(line)
        used = (*self.position, *self.rotation)
        return len(cells) == len(self.names) and not any(cells[k] for k in used)

    def stamp_text(self, line: str) -> str:
        """The stamp as a line has it; empty where two columns hold it."""
        return self._cells(line)[self.stamp[0]] if len(self.stamp) == 1 else ""

    def _cells(self, line: str) -> list[str]:
        cells = _cells(line, self.separator)
        if len(cells) == len(self.names):
            return cells
        return line.replace(",", " ").replace(";", " ").split()  # a header with commas above columns with blanks

    @property
    def states_angles(self) -> bool:
        """Whether the name of a heading states its unit."""
        return bool(_IN_BRACKETS.search(self.names[self.rotation[-1]])) or self.units[self.rotation[-1]] != 1.0

    def _number(self, cells: list[str], column: int) -> float:
        text = cells[column]
        if self.separator in (";", "\t") and "." not in text:
            text = text.replace(",", ".")  # the decimal sign of many countries
        try:
            return float(text) * self.units[column]
        except ValueError:
            raise ValueError(f"expected a number in the column {self.names[column]}, got '{text[:40]}'") from None

    def _time(self, cells: list[str], column: int) -> float:
        """A stamp [s], also one that is a date with a time of day (UTC, unless it says otherwise)."""
        try:
            return self._number(cells, column)
        except ValueError:
            try:
                moment = datetime.fromisoformat(_DATE_WITH_SLASHES.sub(r"\1-\2-\3 ", cells[column]))
            except ValueError:
                moment = None
            if moment is None:
                raise
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def named_columns(line: str) -> NamedColumns | None:
    """Return what a line names, if it names all of a pose; else None. Raises ValueError where it names several."""
    separator = next((sign for sign in (",", ";", "\t") if sign in line), None)
    cells = _cells(line, separator)
    split = [_name_and_unit(cell) for cell in cells]
    where: dict[str, int] = {}
    for k, (name, _) in enumerate(split):
        where.setdefault(name, k)
    stamp = next((found for group in _STAMPS if (found := _all_of(where, group))), None) or _only_stamp(where)
    if stamp is None:
        return None
    position = _first_of(where, _POSITIONS, "xyz") or _first_of(where, _POSITIONS, "xy") or _only_position(where)
    rotation = _rotation(where)
    if position is None or rotation is None:
        return None
    names = [name for name, _ in split]
    if twice := [names[k] for k in (*stamp, *position, *rotation) if names.count(names[k]) > 1]:
        raise ValueError(f"the header names {twice[0]} twice, expected the columns of one pose")
    if len(rotation) == 1:
        position = position[:2]
    return NamedColumns(separator, tuple(cells), tuple(unit for _, unit in split), stamp, position, rotation)


def _name_and_unit(cell: str) -> tuple[str, float]:
    """The words of a name with points between them, and the unit that it states; 1 where it states none."""
    found = _IN_BRACKETS.search(cell)
    unit = None if found is None else _UNITS.get(found.group(1).strip().lower())
    words = [word for word in re.split(r"[./_\s]+", _IN_BRACKETS.sub("", cell).strip("%").lower()) if word]
    if unit is None and len(words) > 1 and words[-1] in _UNITS and words[-2:] != ["stamp", "sec"]:
        unit = _UNITS[words.pop()]
    name = ".".join(words).removeprefix("field.").removeprefix("pose.pose.")
    return name, 1.0 if unit is None else unit


def _only_stamp(where: dict[str, int]) -> Columns | None:
    """The only column whose name ends like that of a stamp, else the first one where it has no name, as in tables of
    pandas whose index is the time."""
    ending = [column for name, column in where.items() if name.split(".")[-1] in ("time", "stamp", "timestamp")]
    if len(ending) == 1:
        return (ending[0],)
    return (0,) if not ending and where.get("") == 0 else None


def _rotation(where: dict[str, int]) -> Columns | None:
    """The columns of a rotation, see `NamedColumns.rotation`."""
    if found := _first_of(where, _ROTATIONS, "xyzw"):
        return found
    if found := next((f for yaw in _YAWS if (f := _all_of(where, ("roll", "pitch", yaw)))), None):
        return found
    if found := next(((where[name],) for name in _YAWS if name in where), None):
        return found
    groups = {words: group for words, group in _groups(where).items() if words}
    for wanted in (("x", "y", "z", "w"), ("z", "w")):
        if (alike := _only([group for group in groups.values() if set(wanted) <= group.keys()])) is not None:
            return tuple(alike[axis] for axis in wanted)
    yaws = [group[name] for group in groups.values() for name in _YAWS if name in group]
    return None if (yaw := _only(yaws)) is None else (yaw,)


def _only_position(where: dict[str, int]) -> Columns | None:
    """The columns of x and y, and z, whose names begin alike."""
    groups = [
        group
        for words, group in _groups(where).items()
        if {"x", "y"} <= group.keys() and "w" not in group and not _NO_POSE.intersection(words)
    ]
    group = _only(groups)
    return None if group is None else tuple(group[axis] for axis in "xyz" if axis in group)


def _only(found: list[Found]) -> Found | None:
    """The only one of what was found; ValueError where there are several."""
    if len(found) > 1:
        raise ValueError(f"the header names {len(found)} poses, expected the columns of one")
    return found[0] if found else None


def _groups(where: dict[str, int]) -> dict[tuple[str, ...], dict[str, int]]:
    """Columns by the words in front of the last one, and then by the last."""
    groups: defaultdict[tuple[str, ...], dict[str, int]] = defaultdict(dict)
    for name, column in where.items():
        *front, last = name.split(".")
        groups[tuple(front)][last] = column
    return groups


def _cells(line: str, separator: str | None) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in line.strip("\r\n").split(separator)]


def _all_of(where: dict[str, int], names: tuple[str, ...]) -> Columns | None:
    return tuple(where[name] for name in names) if all(name in where for name in names) else None


def _first_of(where: dict[str, int], patterns: tuple[str, ...], axes: str) -> Columns | None:
    groups = (tuple(pattern.format(axis) for axis in axes) for pattern in patterns)
    return next((found for group in groups if (found := _all_of(where, group))), None)
