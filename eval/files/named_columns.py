# SPDX-License-Identifier: MIT
"""Columns of a table of poses that its first line names, as CSV files and `rostopic echo -p` do."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from itertools import product

_STAMPS = (
    ("header.stamp.secs", "header.stamp.nsecs"),
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("header.stamp",),
    ("timestamp",),
    ("timestamp_ns",),
    ("stamp",),
    ("time",),
    ("t",),
)
"""Names of a stamp, the best first; of two columns the second counts nanoseconds."""
_POSITIONS = ("pose.position.{}", "position.{}", "position_{}", "pos_{}", "p_rs_r_{}", "p_{}", "p{}", "t{}", "{}")
_ROTATIONS = ("pose.orientation.{}", "orientation.{}", "orientation_{}", "quat_{}", "q_rs_{}", "q_{}", "q{}")
_YAWS = {"yaw": 1.0, "theta": 1.0, "heading": 1.0} | {
    f"{name}{unit}": math.radians(1.0) for name, unit in product(("yaw", "theta", "heading"), ("_deg", "_degrees"))
}
"""Names of a heading, and its unit [rad]."""
_UNIT = re.compile(r"\s*[\[(][^\])]*[\])]\s*$")


@dataclass(frozen=True)
class NamedColumns:
    """Where a line holds what of a pose."""

    separator: str | None
    """Between two cells; None = blanks."""
    width: int
    """Number of cells."""
    stamp: tuple[int, ...]
    position: tuple[int, ...]
    """Of x, y and, where there is one, z."""
    rotation: tuple[int, ...]
    """Of the quaternion x, y, z, w; or of the yaw alone."""
    yaw_unit: float = 1.0
    """[rad]"""

    def pose(self, line: str) -> list[float]:
        """Return `t x y z qx qy qz qw`; ValueError where a line has other cells, or no numbers in those that count."""
        cells = _cells(line, self.separator)
        if len(cells) != self.width:  # a header with commas above columns with blanks
            cells = line.replace(",", " ").replace(";", " ").split()
        if len(cells) != self.width:
            raise ValueError(f"expected {self.width} values as in the header, got {len(cells)}")
        stamp = sum(float(cells[k]) * unit for k, unit in zip(self.stamp, (1.0, 1e-9), strict=False))
        x, y, *z = (float(cells[k]) for k in self.position)
        rotation = [float(cells[k]) for k in self.rotation]
        if len(rotation) == 1:
            half = 0.5 * rotation[0] * self.yaw_unit
            rotation = [0.0, 0.0, math.sin(half), math.cos(half)]
        return [stamp, x, y, *(z or [0.0]), *rotation]


def named_columns(line: str) -> NamedColumns | None:
    """Return what a line names, if it names all of a pose; else None."""
    separator = next((sign for sign in (",", ";", "\t") if sign in line), None)
    names = [_UNIT.sub("", cell).strip("%").lower() for cell in _cells(line, separator)]
    names = [name.removeprefix("field.").removeprefix("pose.pose.").removeprefix("/") for name in names]
    where = {name: k for k, name in reversed(list(enumerate(names)))}
    stamp = next((found for group in _STAMPS if (found := _all_of(where, group))), None)
    position = _first_of(where, _POSITIONS, "xyz") or _first_of(where, _POSITIONS, "xy")
    if stamp is None or position is None:
        return None
    rotation = _first_of(where, _ROTATIONS, "xyzw")
    if rotation is not None:
        return NamedColumns(separator, len(names), stamp, position, rotation)
    yaw = next((name for name in _YAWS if name in where), None)
    if yaw is None:
        return None
    return NamedColumns(separator, len(names), stamp, position[:2], (where[yaw],), _YAWS[yaw])


def _cells(line: str, separator: str | None) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in line.strip("\r\n").split(separator)]


def _all_of(where: dict[str, int], names: tuple[str, ...]) -> tuple[int, ...] | None:
    return tuple(where[name] for name in names) if all(name in where for name in names) else None


def _first_of(where: dict[str, int], patterns: tuple[str, ...], axes: str) -> tuple[int, ...] | None:
    groups = (tuple(pattern.format(axis) for axis in axes) for pattern in patterns)
    return next((found for group in groups if (found := _all_of(where, group))), None)
