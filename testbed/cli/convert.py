# SPDX-License-Identifier: MIT
"""`testbed convert`."""

from __future__ import annotations

from pathlib import Path

from testbed.cli.shared.console import console
from testbed.formats import open_log
from testbed.formats.write import HOLDS, LogFormat, parts_of, write_log


def convert(
    log: Path,
    out: Path,
    *,
    to: LogFormat,
    laser_offset: float | None = None,
    range_max: float | None = None,
) -> None:
    """Turn a recorded log into another format; what both formats can hold is kept.

    Parameters
    ----------
    log
        A recorded log; its format is recognised from the content.
    out
        File or directory to write; a CARMEN log is packed with gzip where the name ends in `.gz`.
    to
        rosbag2: ROS 2 directory with an MCAP file; rosbag2-lean: without point clouds; rosbag2-sqlite: with a .db3
        file; rosbag1: one .bag file for ROS 1; carmen: CARMEN log with `ROBOTLASER` lines, for any lidar;
        carmen-flaser: the older `FLASER` lines; parquet: directory with a table, which rounds nothing; tum: directory
        with the trajectories; map_server: the true map (.yaml and .pgm).
    laser_offset
        x of the laser in the robot's frame [m]; default: what the log says.
    range_max
        Readings from here on are no returns [m]; default: what the log says or shows.
    """
    if out.exists():  # complain before a large log is read
        raise ValueError(f"{out}: exists; choose another name")
    read = open_log(log, laser_offset=laser_offset, range_max=range_max, scans_needed=False)
    write_log(out, read, to)
    for note in read.notes:
        console.print(f"{log}: {note}", soft_wrap=True)
    if lost := sorted(parts_of(read) - HOLDS[to]):
        console.print(f"{out}: {to} cannot hold {', '.join(lost)}: left out", soft_wrap=True)
    console.print(f"{out}: {len(read.frames)} frames, {read.scan_count} of them with a scan", soft_wrap=True)
