# SPDX-License-Identifier: MIT
"""Logs written in any of the formats, by name."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

from eval.files.atomic_write import atomic_directory
from eval.files.map_server import write_map
from testbed.formats.carmen.reader import LIDARS
from testbed.formats.carmen.writer import write_carmen
from testbed.formats.checksums import seal_directory
from testbed.formats.log import Log, LogError
from testbed.formats.parquet import write_parquet
from testbed.formats.ros.writer import write_bag
from testbed.formats.tum import write_trajectories

Form = Literal[
    "rosbag2", "rosbag2-lean", "rosbag2-sqlite", "rosbag1", "carmen", "carmen-flaser", "parquet", "tum", "map_server"
]
"""rosbag2: directory with an MCAP file; -lean: without point clouds; -sqlite: with a .db3 file instead; rosbag1: one
.bag file; carmen: text log; -flaser: with its older messages; parquet: directory with a table; tum: directory of
trajectories; map_server: the true map alone."""


Part = Literal[
    "odometry", "twist", "command", "truth", "scans", "lidar names", "range_min", "beam times", "true map", "robot"
]
"""What a log may hold."""

_EVERYTHING: frozenset[Part] = frozenset(get_args(Part))
HOLDS: dict[Form, frozenset[Part]] = {
    "rosbag2": _EVERYTHING,
    "rosbag2-lean": _EVERYTHING,
    "rosbag2-sqlite": _EVERYTHING,
    "rosbag1": _EVERYTHING,
    "parquet": _EVERYTHING,
    "carmen": frozenset(("odometry", "twist", "truth", "scans")),
    "carmen-flaser": frozenset(("odometry", "truth", "scans")),
    "tum": frozenset(("odometry", "truth")),
    "map_server": frozenset(("true map",)),
}
"""What each format has a place for."""


def parts_of(log: Log) -> set[Part]:
    """What a log holds."""
    frames, scans = log.frames, [frame.scan for frame in log.frames if frame.scan is not None]
    there: dict[Part, bool] = {
        "odometry": True,
        "twist": any(frame.twist is not None for frame in frames),
        "command": any(frame.command is not None for frame in frames),
        "truth": any(frame.truth is not None for frame in frames),
        "scans": bool(scans),
        "lidar names": any(frame.lidar not in LIDARS.values() for frame in frames if frame.scan is not None),
        "range_min": any(scan.range_min > 0.0 for scan in scans),
        "beam times": any(scan.time_offsets is not None for scan in scans),
        "true map": log.truth_map is not None,
        "robot": log.robot_urdf is not None,
    }
    return {part for part, is_there in there.items() if is_there}


def write_log(path: str | Path, log: Log, form: Form) -> None:
    """Write a log; `path`, a file or a directory, must not exist. What a format has no place for is left out.

    Directories get a config.toml with the SHA-256 of their files, which `open_log` verifies. Raises LogError where the
    format cannot hold the frames at all.
    """
    path = Path(path)
    if path.exists():
        raise LogError(f"{path}: exists; choose another name")
    if form == "rosbag1" and path.suffix != ".bag":
        raise LogError(f"{path}: a ROS 1 bag needs a name that ends in .bag")
    if form in ("carmen", "carmen-flaser"):
        write_carmen(path, log.frames, message="FLASER" if form == "carmen-flaser" else "ROBOTLASER")
    elif form == "map_server":
        if log.truth_map is None:
            raise LogError(f"{log.path}: holds no true map to write")
        write_map(path, log.truth_map)
    else:
        with atomic_directory(path) as aside:
            if form == "parquet":
                write_parquet(aside, log)
            elif form == "tum":
                write_trajectories(aside, log)
            else:
                write_bag(
                    aside,
                    log.frames,
                    storage="rosbag1" if form == "rosbag1" else "sqlite" if form == "rosbag2-sqlite" else "mcap",
                    truth_map=log.truth_map,
                    robot_urdf=log.robot_urdf,
                    cloud=form == "rosbag2",
                )
            if aside.is_dir():
                seal_directory(aside, {"source": {"name": log.path.name, "format": log.format}})
