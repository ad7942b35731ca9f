# SPDX-License-Identifier: MIT
"""Recorded logs in and out. `open_log(path)` recognises the format from the content."""

from __future__ import annotations

import zlib
from pathlib import Path

from testbed.formats.carmen import MESSAGES, read_carmen
from testbed.formats.log import Log, LogError
from testbed.formats.ros_bag import read_bag

__all__ = ["Log", "LogError", "open_log"]

SNIFFED = 1 << 20
"""Bytes looked at to recognise a text format."""

BAG_BEGINNINGS = (b"#ROSBAG V2.0", b"\x89MCAP0\r\n", b"SQLite format 3\x00")
"""First bytes of ROS 1 bags, MCAP files and SQLite data bases."""


def open_log(path: str | Path, *, laser_offset: float | None = None, range_max: float | None = None) -> Log:
    """Read a recorded log whole; the format is recognised from the content, not from the name.

    laser_offset, range_max [m] override what the log says, see `read_carmen`. Raises LogError, with one line that
    names the file, the place and what was expected, for anything that cannot be read.
    """
    path = Path(path)
    if not path.exists():
        raise LogError(f"{path}: no such file")
    if _is_carmen(path):
        return read_carmen(path, laser_offset=laser_offset, range_max=range_max)
    if _is_bag(path):
        if laser_offset is not None:
            raise LogError(f"{path}: a bag tells the lidar's mount by its transforms, no laser offset can be given")
        return read_bag(path, range_max=range_max)
    raise LogError(f"{path}: not a log that can be read: expected a CARMEN log (plain or .gz) or a ROS 1 or 2 bag")


def _is_bag(path: Path) -> bool:
    """Whether it is a rosbag2 directory, or a single file that begins like a bag."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    return any(_head(path).startswith(magic) for magic in BAG_BEGINNINGS)


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
            start = raw.read(SNIFFED)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from None
    if not start.startswith(b"\x1f\x8b"):
        return start
    try:
        return zlib.decompressobj(wbits=16 + zlib.MAX_WBITS).decompress(start, SNIFFED)
    except zlib.error as error:
        raise LogError(f"{path}: damaged gzip file ({error})") from None
