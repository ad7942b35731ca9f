# SPDX-License-Identifier: MIT
"""A recorded log as every reader returns it, and the one error that readers raise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from slam.occupancy import OccupancyGrid
from testbed.frame import Frame
from testbed.frame_table import FrameTable

MAX_QUOTED = 200
"""Largest number of characters that a complaint quotes of a file."""


def shortened(text: str) -> str:
    """Return a text for a complaint, cut where it is long: it may be a whole file."""
    return text if len(text) <= MAX_QUOTED else f"{text[:MAX_QUOTED]} …"


class LogError(ValueError):
    """A log cannot be read or written; the message names the file, the place and what was expected."""


class Topic(NamedTuple):
    """A topic of a bag, or a kind of message of a text log."""

    name: str
    type: str
    messages: int
    use: str = ""
    """What it is read for; empty = it is left out."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Log:
    """A recorded log, read whole."""

    path: Path
    """The file or directory that was read."""
    format: str
    """Name of its format, as a person says it."""
    table: FrameTable
    """All frames as arrays, in the order of the file, which is not always that of the stamps."""
    notes: tuple[str, ...] = ()
    """Sentences for the user: what the reader found out, repaired or left out."""
    repairs: tuple[str, ...] = ()
    """Those of the notes that tell of a fault, and how it was mended."""
    topics: tuple[Topic, ...] = ()
    """What the recording holds, as far as its format has topics."""

    truth_map: OccupancyGrid | None = None
    """The true map, where the log holds it."""
    robot_urdf: str | None = None
    """The robot's description, where the log holds it."""

    @classmethod
    def from_frames(
        cls,
        frames: Sequence[Frame],
        *,
        path: Path,
        format: str,
        notes: tuple[str, ...] = (),
        truth_map: OccupancyGrid | None = None,
        robot_urdf: str | None = None,
    ) -> Log:
        """Make a log of frames."""
        table = FrameTable.from_frames(frames)
        return cls(path=path, format=format, table=table, notes=notes, truth_map=truth_map, robot_urdf=robot_urdf)

    @cached_property
    def frames(self) -> list[Frame]:
        """All frames, one object each; they are made at the first use."""
        return self.table.frames()

    @property
    def scan_count(self) -> int:
        """Number of frames that carry a scan."""
        return len(self.table.scan_rows)

    def __repr__(self) -> str:
        """One line, for notebooks: a recording printed whole is megabytes long."""
        stamps = self.table.stamps
        span = f"{stamps.max() - stamps.min():.1f} s" if len(stamps) else "0 s"
        lidars = ", ".join(self.table.lidars) or "no lidar"
        return (
            f"<Log {self.path.name!r}: {self.format}, {len(stamps)} frames, {self.scan_count} scans ({lidars}), {span}>"
        )
