# SPDX-License-Identifier: MIT
"""Logs written in any of the formats, by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from eval.files.atomic_write import atomic_directory
from eval.files.map_server import write_map
from testbed.formats.carmen.reader import LIDARS
from testbed.formats.carmen.writer import write_carmen
from testbed.formats.checksums import seal_directory
from testbed.formats.head import LogHead
from testbed.formats.log import Log, LogError
from testbed.formats.parquet import write_parquet
from testbed.formats.ros.writing.storages import Storage
from testbed.formats.ros.writing.writer import write_bag
from testbed.formats.tum import write_trajectories
from testbed.frame_table import FrameTable

LogFormat = Literal[
    "rosbag2", "rosbag2-lean", "rosbag2-sqlite", "rosbag1", "carmen", "carmen-flaser", "parquet", "tum", "map_server"
]
"""rosbag2: directory with an MCAP file; -lean: without point clouds; -sqlite: with a .db3 file instead; rosbag1: one
.bag file; carmen: text log; -flaser: with its older messages; parquet: directory with a table; tum: directory of
trajectories; map_server: the true map alone."""


Part = Literal[
    "odometry", "twist", "command", "truth", "scans", "lidar names", "range_min", "beam times", "true map", "robot"
]
"""A kind of data that a log may hold."""

_EVERYTHING: frozenset[Part] = frozenset(get_args(Part))
HOLDS: dict[LogFormat, frozenset[Part]] = {
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
"""The kinds of data that each format can hold."""


STORAGES: dict[LogFormat, Storage] = {
    "rosbag2": "mcap",
    "rosbag2-lean": "mcap",
    "rosbag2-sqlite": "sqlite",
    "rosbag1": "rosbag1",
}
"""How the file of each kind of bag is laid out."""


def parts_of(log: Log) -> set[Part]:
    """Return the kinds of data that a log holds."""
    table = log.table
    used = {table.lidars[k] for k in np.unique(table.scan_lidars).tolist()}
    there: dict[Part, bool] = {
        "odometry": True,
        "twist": bool(table.known(table.twist).any()),
        "command": bool(table.known(table.command).any()),
        "truth": bool(table.known(table.truth).any()),
        "scans": bool(len(table.scan_rows)),
        "lidar names": not used <= set(LIDARS.values()),
        "range_min": bool((table.range_limits[:, 0] > 0.0).any()),
        "beam times": any(table.patterns[k].time_offsets is not None for k in np.unique(table.scan_patterns)),
        "true map": log.truth_map is not None,
        "robot": log.robot_urdf is not None,
    }
    return {part for part, is_there in there.items() if is_there}


def write_log(path: str | Path, log: Log, log_format: LogFormat, *, compressed: bool = False) -> None:
    """Write a log; `path`, a file or a directory, must not exist. Data that the format cannot hold is left out.

    compressed: pack the chunks of bags, see `write_bag`
    Directories get a config.toml with the SHA-256 of their files, which `open_log` verifies. Raises LogError where the
    format cannot hold the frames at all.
    """
    path = Path(path)
    source = {"name": log.path.name, "format": log.format}
    if log_format == "map_server":
        if log.truth_map is None:
            raise LogError(f"{log.path}: holds no true map to write")
        _check_free(path, log_format)
        write_map(path, log.truth_map)
    elif log_format == "tum":
        _check_free(path, log_format)
        with atomic_directory(path) as temporary:
            write_trajectories(temporary, log)
            seal_directory(temporary, {"source": source})
    else:
        write_blocks(path, log.table.blocks(), LogHead.of(log), log_format, source=source, compressed=compressed)


def write_blocks(
    path: Path,
    blocks: Iterable[FrameTable],
    head: LogHead,
    log_format: LogFormat,
    *,
    source: Mapping[str, str],
    compressed: bool = False,
) -> None:
    """Write a recording a block at a time, as `write_log` does; only one block is in memory.

    source: name and format of what is written, for `config.toml`
    """
    _check_free(path, log_format)
    if log_format in ("carmen", "carmen-flaser"):
        write_carmen(path, blocks, head, message="FLASER" if log_format == "carmen-flaser" else "ROBOTLASER")
        return
    with atomic_directory(path) as temporary:
        if log_format == "parquet":
            write_parquet(temporary, blocks, head)
        else:
            storage, cloud = STORAGES[log_format], log_format == "rosbag2"
            write_bag(temporary, blocks, head, storage=storage, cloud=cloud, compressed=compressed)
        if temporary.is_dir():
            seal_directory(temporary, {"source": source})


def _check_free(path: Path, log_format: LogFormat) -> None:
    if path.exists():
        raise LogError(f"{path}: exists; choose another name")
    if log_format == "rosbag1" and path.suffix != ".bag":
        raise LogError(f"{path}: a ROS 1 bag needs a name that ends in .bag")
