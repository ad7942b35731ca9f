# SPDX-License-Identifier: MIT
"""A recorded log as every reader returns it, and the one error that readers raise."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from slam.occupancy import OccupancyGrid
from testbed.frame import Frame


class LogError(ValueError):
    """A log cannot be read or written; the message names the file, the place and what was expected."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """A recorded log, read whole."""

    path: Path
    """The file or directory that was read."""
    format: str
    """Name of its format, as a person says it."""
    frames: list[Frame]
    """All frames, in the order of the file, which is not always that of the stamps."""
    notes: tuple[str, ...]
    """Sentences for the user: what the reader found out, repaired or left out."""

    truth_map: OccupancyGrid | None = None
    """The true map, where the log holds it."""
    robot_urdf: str | None = None
    """The robot's description, where the log holds it."""

    @property
    def scan_count(self) -> int:
        """Number of frames that carry a scan."""
        return sum(frame.scan is not None for frame in self.frames)
