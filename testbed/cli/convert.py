# SPDX-License-Identifier: MIT
"""`testbed convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from testbed.cli.console import console
from testbed.formats import open_log
from testbed.formats.carmen_writer import write_carmen
from testbed.formats.ros_bag_writer import write_bag


def convert(
    log: Path,
    out: Path,
    *,
    to: Literal["carmen", "carmen-flaser", "rosbag2"],
    laser_offset: float | None = None,
    range_max: float | None = None,
) -> None:
    """Turn a recorded log into another format; what both formats can hold is kept to the last digit.

    Parameters
    ----------
    log
        A recorded log; its format is recognised from the content.
    out
        File or directory to write; a CARMEN log is packed with gzip where the name ends in `.gz`.
    to
        carmen: CARMEN log with `ROBOTLASER1` lines, for any lidar; carmen-flaser: the older `FLASER` lines;
        rosbag2: directory with MCAP file.
    laser_offset
        x of the laser in the robot's frame [m]; default: what the log says.
    range_max
        Readings from here on are no returns [m]; default: what the log says or shows.
    """
    if out.exists():
        raise ValueError(f"{out}: exists; choose another name")
    read = open_log(log, laser_offset=laser_offset, range_max=range_max)
    if to == "rosbag2":
        write_bag(out, read.frames)
    else:
        write_carmen(out, read.frames, message="FLASER" if to == "carmen-flaser" else "ROBOTLASER1")
    for note in read.notes:
        console.print(f"{log}: {note}")
    console.print(f"{out}: {len(read.frames)} frames, {read.scan_count} of them with a scan")
