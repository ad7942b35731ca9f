# SPDX-License-Identifier: MIT
"""The input of a run: source of the frames, the system, references."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eval.map.lidar_view import LidarView
from eval.trajectory.relations import Relations
from slam.occupancy import OccupancyGrid
from slam.step.step_report import StepReport
from testbed.frame import Frame
from testbed.run.followed import Followed


class FrameSource(Protocol):
    """The source of the frames: a recording, or a robot that drives during the run."""

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames in the order in which they are to be processed."""
        ...

    @property
    def share_done(self) -> float | None:
        """Share of the frames that were given, in [0, 1]; None = unknown."""
        ...

    @property
    def collided(self) -> bool:
        """Whether the robot has touched something so far."""
        ...

    @property
    def ended(self) -> str | None:
        """Why the drive did not end as planned, known after the last frame: `collided`, `timeout`; None = it did."""
        ...

    def observe(self, frame: Frame, report: StepReport, make_map: Callable[[], OccupancyGrid]) -> None:
        """Process the report on a scan before the next frame is given; it may steer a robot."""
        ...


@dataclass
class RecordedFrames:
    """The frames of a recording."""

    frames: Sequence[Frame]
    ended: str | None = None
    """Why the recorded drive did not end as planned, if known; None = it did."""
    collided = False
    _taken: int = field(init=False, default=0)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames in their order."""
        for number, frame in enumerate(self.frames, start=1):
            self._taken = number
            yield frame

    @property
    def share_done(self) -> float:
        """Share of the frames that were given, in [0, 1]."""
        return self._taken / len(self.frames)

    def observe(self, frame: Frame, report: StepReport, make_map: Callable[[], OccupancyGrid]) -> None:
        """Do nothing, because a recording cannot be steered."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """Everything that a run needs, except the directory that it writes to."""

    source: FrameSource
    """Source of the frames."""
    document: Mapping[str, Any]
    """Content of `config.toml`."""
    seed: int
    """Seed of the system."""
    system: Followed
    """The system that processes the frames; it was not started yet."""
    truth_map: OccupancyGrid | None = None
    """The true map: 1 occupied, 0 free, NaN not visible to any lidar."""
    truth_walls: NDArray[np.float64] | None = None
    """The exact true walls `(x0, y0, x1, y1)` [m], (n, 4), in the frame of the true map."""
    lidars: Sequence[LidarView] = ()
    """Views of the lidars, if they are known for the whole drive; empty = they are found in the frames."""
    observable: NDArray[np.bool_] | None = None
    """What these lidars could see of the true map (`eval.scoring.cells_in_sight`); None = it is computed."""
    aligns_map: bool = True
    """Whether the map is also scored where it fits best (`map.best_rigid`), which takes most of the time of scoring."""
    checks_by_replay: bool = True
    """Whether the self-check draws the map of the estimate once more; otherwise it is the filter's own verdict."""
    relations: Relations | None = None
    """Hand-checked relations between poses."""
    notes: Sequence[str] = ()
    """What is doubtful about the recording, or was mended when it was read, for `metrics.json` and the report."""
