# SPDX-License-Identifier: MIT
"""Beams of a drive that did not end on a wall, as a table `stamp,x,y,direction,range`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from eval.files.atomic_write import atomic_write
from testbed.formats.csv_table import read_table
from testbed.formats.log import LogError
from testbed.simulation.robot.off_wall import OffWallBeams

COLUMNS = ("stamp", "x", "y", "direction", "range")
"""First line of the table; units are s, m, m, rad, m."""


def read_off_wall(path: str | Path) -> OffWallBeams:
    """Read a table; it may have no rows.

    Raises LogError, naming the file and the line, where a value is none of its column (a range may be `inf` or `nan`),
    or where the stamps step backwards.
    """
    path = Path(path)
    rows: list[list[float]] = []
    for line, values in read_table(path, COLUMNS):
        if not all(map(math.isfinite, values[:-1])):
            raise LogError(f"{path}:{line}: expected finite numbers before the range, got {str(values)[1:81]}")
        if values[-1] <= 0.0:
            raise LogError(f"{path}:{line}: range {values[-1]:g}, expected a positive one, inf or nan")
        if rows and values[0] < rows[-1][0]:
            raise LogError(f"{path}:{line}: stamp {values[0]:g} after {rows[-1][0]:g}, expected increasing stamps")
        rows.append(values)
    table = np.array(rows, dtype=np.float64).reshape(-1, len(COLUMNS))
    return OffWallBeams(stamps=table[:, 0], origins=table[:, 1:3], directions=table[:, 3], ranges=table[:, 4])


def write_off_wall(path: str | Path, beams: OffWallBeams) -> None:
    """Write a table, to a tenth of a millimetre and a microsecond; it appears whole or not at all."""
    columns = np.column_stack([beams.stamps, beams.origins, beams.directions, beams.ranges])
    with atomic_write(path) as aside:
        formats = ("%.6f", "%.4f", "%.4f", "%.6f", "%.4f")
        np.savetxt(aside, columns, fmt=formats, delimiter=",", header=",".join(COLUMNS), comments="")
