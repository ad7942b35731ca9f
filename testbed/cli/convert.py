# SPDX-License-Identifier: MIT
"""`testbed convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import console
from testbed.formats.write import HOLDS, LogFormat, parts_of, write_log
from testbed.inspect import AS_STATED, Reading


def convert(
    log: Path,
    out: Path,
    *,
    to: LogFormat,
    reading: Annotated[Reading, Parameter(name="*")] = AS_STATED,
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
    """
    if out.exists():  # complain before a large log is read
        raise ValueError(f"{out}: exists; choose another name")
    with AT_WORK.doing(f"reading {log}"):
        read = reading.open(log, scans_needed=False)
    with AT_WORK.doing(f"writing {out}"):
        write_log(out, read, to)
    for note in read.notes:
        console.print(f"{log}: {note}", soft_wrap=True)
    if lost := sorted(parts_of(read) - HOLDS[to]):
        console.print(f"{out}: {to} cannot hold {', '.join(lost)}: left out", soft_wrap=True)
    console.print(f"{out}: {len(read.frames)} frames, {read.scan_count} of them with a scan", soft_wrap=True)
