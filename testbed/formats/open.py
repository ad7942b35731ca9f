# SPDX-License-Identifier: MIT
"""`open_log(path)` reads a recorded log; it recognises the format from the content."""

from __future__ import annotations

import re
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from slam.scan import MAX_MOUNT
from testbed.formats.carmen.reader import MESSAGES, read_carmen
from testbed.formats.checksums import CONFIG, verify
from testbed.formats.log import Log, LogError
from testbed.formats.parquet import TABLE, read_parquet
from testbed.formats.ros.reading.content import Selection
from testbed.formats.ros.reading.reader import read_bag
from testbed.formats.ros.salvage import bag_files, is_packed
from testbed.formats.tum import ODOMETRY, read_trajectories
from worlds.regular_file import refuse_devices

MAX_SNIFFED = 1 << 20
"""Number of bytes that are searched to recognise a text format."""

FARTHEST = 1e8
"""Largest number of a pose [m, rad]; the earth's circumference is 4e7 m."""
BAG_BEGINNINGS = (b"#ROSBAG V2.0", b"\x89MCAP0\r\n", b"SQLite format 3\x00")
"""First bytes of ROS 1 bags, MCAP files and SQLite data bases."""
PARQUET_BEGINNING = b"PAR1"
ARCHIVE_BEGINNINGS = (b"PK\x03\x04", b"7z\xbc\xaf", b"Rar!")
"""First bytes of archives; tar has its mark at byte 257."""


def open_log(
    path: str | Path,
    *,
    laser_offset: float | None = None,
    range_max: float | None = None,
    heights: tuple[float, float] | None = None,
    namespace: str | None = None,
    topics: tuple[str, ...] = (),
    scans_needed: bool = True,
) -> Log:
    """Read a recorded log whole; the format is recognised from the content, not from the name.

    laser_offset, range_max [m] override what the log says, see `read_carmen`; heights [m]: scans are made of the points
    between them of the point clouds of a bag; namespace, topics: the robot, and the topics, that are read of a bag with
    several. Raises LogError, with one line that names the file, the place and what was expected, for anything that
    cannot be read and, if `scans_needed`, for a log without scans.
    """
    path = Path(path)
    recording = path.parent if path.name == "metadata.yaml" and path.is_file() else path
    log = _read(recording, laser_offset, range_max, Selection(heights, namespace, topics))
    _check_mounts(path, log)
    _check_poses(path, log)
    if scans_needed and not log.scan_count:
        raise LogError("; ".join([f"{path}: no scans in this {log.format}", *log.notes]))
    return log


def _check_mounts(path: Path, log: Log) -> None:
    """Raise LogError for a lidar far from the robot: its map would take the memory of a map as large."""
    places = log.table.mounts[:, :2]
    far = np.flatnonzero(~(np.abs(places) <= MAX_MOUNT).all(axis=1))
    if len(far):
        name = log.table.lidars[log.table.scan_lidars[far[0]]]
        at = ", ".join(f"{value:g}" for value in places[far[0]])
        raise LogError(
            f"{path}: scan {far[0] + 1}: lidar {name or 'laser'} is mounted at {at} m, expected within {MAX_MOUNT:g} m "
            "of the robot"
        )


def _check_poses(path: Path, log: Log) -> None:
    """Raise LogError for a pose whose squares would overflow: distances, errors and pictures would be infinite."""
    for name, poses in (("odometry", log.table.odometry), ("truth", log.table.truth)):
        far = np.flatnonzero((np.abs(poses) > FARTHEST).any(axis=1))
        if len(far):
            at = ", ".join(f"{value:g}" for value in poses[far[0]])
            raise LogError(
                f"{path}: frame {far[0] + 1}: {name} {at} (m, m, rad), expected numbers of at most {FARTHEST:g}"
            )


def _read(path: Path, laser_offset: float | None, range_max: float | None, selection: Selection) -> Log:
    if not path.exists():
        raise LogError(f"{path}: no such file")
    try:
        refuse_devices(path)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}") from None
    if within := _recordings_below(path):
        if len(within) > 1:
            raise LogError(f"{path}: holds {len(within)} recordings; name one, such as {within[0]}")
        log = _read(within[0], laser_offset, range_max, selection)
        return replace(log, notes=(f"read {within[0].name}, the only recording in {path}", *log.notes))
    path = _recording_in(path)
    if _is_bag(path):
        return read_bag(path, laser_offset=laser_offset, range_max=range_max, selection=selection)
    if selection.heights is not None:
        raise LogError(f"{path}: a slice of heights is for point clouds in bags")
    if selection.namespace is not None or selection.topics:
        raise LogError(f"{path}: namespaces and topics are those of bags")
    if _is_carmen(path):
        return read_carmen(path, laser_offset=laser_offset, range_max=range_max)
    if laser_offset is not None:
        raise LogError(f"{path}: only CARMEN logs and bags take a laser offset, other formats hold the lidar's mount")
    for recognised, read in ((_is_parquet, read_parquet), (_is_trajectory, read_trajectories)):
        if recognised(path):
            if range_max is not None:
                raise LogError(f"{path}: holds the range of its lidars; no other can be given")
            return read(path)
    what = "an archive, unpack it first" if _is_archive(path) else "not a log that can be read"
    raise LogError(
        f"{path}: {what}: expected a CARMEN log (plain or .gz), a ROS 1 or 2 bag, a Parquet table or a TUM trajectory"
    )


def _is_archive(path: Path) -> bool:
    """Whether it is a file that holds others: ZIP, 7z, RAR, or tar, also within gzip."""
    return path.is_file() and (_head(path).startswith(ARCHIVE_BEGINNINGS) or _head(path)[257:262] == b"ustar")


def _recordings_below(path: Path) -> list[Path]:
    """The recordings in a directory that is none itself, sorted by name: what `testbed simulate --out` wrote to."""
    if not path.is_dir() or (path / CONFIG).is_file() or _is_bag(path) or _is_parquet(path) or _is_trajectory(path):
        return []
    below = (child for child in sorted(path.iterdir()) if child.is_dir() and not child.name.startswith("."))
    return [child for child in below if (child / CONFIG).is_file() or _is_bag(child)]


def _recording_in(path: Path) -> Path:
    """The recording itself, where a dataset's directory holds it as one file among others."""
    if not (path / CONFIG).is_file() or any((path / name).is_file() for name in ("metadata.yaml", TABLE, ODOMETRY)):
        return path
    verify(path)
    found = [file for file in sorted(path.iterdir()) if file.name.endswith((".log.gz", ".bag"))]
    if len(found) != 1:
        raise LogError(f"{path}: expected one recording (.log.gz, .bag) in this dataset, found {len(found)}")
    return found[0]


def _is_bag(path: Path) -> bool:
    """Tell whether it is a rosbag2 directory, with or without metadata, or a single file that begins like a bag."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or bool(bag_files(path))
    return any(_head(path).startswith(magic) for magic in BAG_BEGINNINGS) or is_packed(path)


def _is_parquet(path: Path) -> bool:
    return (path / TABLE).is_file() if path.is_dir() else _head(path).startswith(PARQUET_BEGINNING)


def _is_trajectory(path: Path) -> bool:
    """Whether it is a directory with odometry, or a file whose first line with anything in it has eight numbers."""
    if path.is_dir():
        return (path / ODOMETRY).is_file()
    lines = (line.partition(b"#")[0].split() for line in _head(path).splitlines())
    first = next((words for words in lines if words), [])
    return len(first) == 8 and all(re.fullmatch(rb"[-+0-9.eE]+", word) for word in first)


def _is_carmen(path: Path) -> bool:
    """Whether a line within the first megabyte starts with the name of a CARMEN message."""
    if path.is_dir():
        return False
    return any(
        line.split(maxsplit=1)[:1] in ([name.encode()] for name in MESSAGES) for line in _head(path).splitlines()
    )


def _head(path: Path) -> bytes:
    """The first bytes of a file, unpacked if it is gzip; what a damaged gzip file still yields."""
    try:
        with path.open("rb") as raw:
            start = raw.read(MAX_SNIFFED)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from None
    if not start.startswith(b"\x1f\x8b"):
        return start
    try:
        return zlib.decompressobj(wbits=16 + zlib.MAX_WBITS).decompress(start, MAX_SNIFFED)
    except zlib.error as error:
        raise LogError(f"{path}: damaged gzip file ({error})") from None
