# SPDX-License-Identifier: MIT
"""`testbed convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from testbed.cli.console import console
from testbed.formats import open_log
from testbed.formats.carmen_writer import write_carmen


def convert(
    log: Path,
    out: Path,
    *,
    to: Literal["carmen", "carmen-flaser"],
    laser_offset: float | None = None,
    range_max: float | None = None,
    overwrite: bool = False,
) -> None:
    """Turn a recorded log into another format; what both formats can hold is kept to the last digit.

    Parameters
    ----------
    log
        A recorded log; its format is recognised from the content.
    out
        File to write; gzip where the name ends in `.gz`.
    to
        carmen: CARMEN log with `ROBOTLASER1` lines, for any lidar; carmen-flaser: the older `FLASER` lines.
    laser_offset
        x of the laser in the robot's frame [m]; default: what the log says.
    range_max
        Readings from here on are no returns [m]; default: what the log says or shows.
    overwrite
        Replace a file that exists.
    """
    if out.exists() and not overwrite:
        raise ValueError(f"{out}: exists; choose another name or add --overwrite")
    read = open_log(log, laser_offset=laser_offset, range_max=range_max)
    write_carmen(out, read.frames, message="FLASER" if to == "carmen-flaser" else "ROBOTLASER1")
    for note in read.notes:
        console.print(f"{log}: {note}")
    console.print(f"{out}: {len(read.frames)} frames, {read.scan_count} of them with a scan")
