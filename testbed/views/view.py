# SPDX-License-Identifier: MIT
"""The data that a run shows, the interface of a view that takes them, and a view that does nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Literal, Protocol, Self
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from slam.config import MotionConfig
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose
from slam.step.step_report import StepReport
from testbed.views.map_cells import MapCells
from worlds.file_names import readable

SCHEMES = ("rerun", "rerun+http", "rerun+https")
"""Schemes of the addresses of Rerun's viewers and servers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """What is known before the first scan."""

    title: str
    """Name of the run, e.g. "office, 30 particles"."""
    settings: str = ""
    """Everything that was set, as markdown."""
    particles: int = 1
    """Number of particles of the filter, at most."""
    true_map: OccupancyGrid | None = None
    """The true map in the world's frame, if known."""
    T_world_map: Pose | None = None
    """The map's frame seen from the world's, (3,); None = both paths start at the same pose."""
    robot_radius: float = 0.2
    """Radius of the robot's footprint [m]."""
    motion: MotionConfig | None = None
    """The filter's motion model, to show what it predicts; None = unknown."""

    def __post_init__(self) -> None:
        for name in ("title", "settings"):  # they may hold a path
            object.__setattr__(self, name, readable(getattr(self, name)))


@dataclass(frozen=True, kw_only=True, eq=False)
class SystemLayer:
    """What one of several systems made of a drive, in the frame that all are drawn in: the world's, if it is known."""

    name: str
    colour: tuple[int, int, int]
    rows: NDArray[np.intp]
    """Numbers of the scans that it has poses at, increasing, (poses,)."""
    poses: Pose
    """Its poses there, (poses, 3)."""
    errors: NDArray[np.float64] | None = None
    """Distances from the truth at these scans [m], NaN = unknown, (poses,); None where there is no truth."""
    grid: OccupancyGrid | None = None
    """Its final map, if it has one."""
    particles: Mapping[int, tuple[Pose, NDArray[np.float64]]] = field(default_factory=dict)
    """Its particles while driving: poses (n, 3) and weights (n,), by the number of the scan."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """Lines 4 to 21 of Algorithm 1 for the best particle, in the map's frame."""

    samples: Pose
    """The K poses that were drawn about the optimum, (K, 3)."""
    weights: NDArray[np.float64] | None
    """Weight of each sample, (K,), the largest is 1; None = unknown."""
    mean: Pose
    """Mean of the Gaussian that was fitted to the samples, (3,)."""
    covariance: NDArray[np.float64]
    """Its covariance, (3, 3)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """What is known at one scan.

    Poses of the estimate are in the map's frame, those of the odometry in its own, the truth in the world's: a view
    aligns them at the first snapshot.
    """

    stamp: float
    """Time of the scan [s]."""
    estimate: Pose
    """`T_map_robot`, (3,)."""
    odometry: Pose
    """`T_odom_robot`, (3,)."""
    truth: Pose | None = None
    """`T_world_robot`, (3,), if known."""
    scan: Scan | None = None
    """The scan itself."""
    step: StepReport | None = None
    """What the scan did to the filter."""
    poses: Pose | None = None
    """`T_map_robot` of each particle, (particles, 3)."""
    weights: NDArray[np.float64] | None = None
    """Weights of the particles, (particles,)."""
    best: int = 0
    """Number of the best particle among `poses`: the step's own `best` is its number before resampling."""
    proposal: Proposal | None = None
    """How the new pose of the best particle was found; None where matching failed, or with another proposal."""
    localization: str | None = None
    """State of a localisation: searching, ambiguous or found; None while a map is made."""
    collided: bool = False
    """Whether the robot has touched something."""
    notes: tuple[str, ...] = ()
    """Further warnings for the event log."""
    path: Callable[[int | None], Pose] | None = None
    """Path of a particle (None = the best) through all updates, (updates, 3); called about once a second."""
    cells: Callable[[int], MapCells] | None = None
    """Map of a particle as the filter stores it; called about once a second. None = the map is `map`."""
    map: Callable[[int | None], OccupancyGrid] | None = None
    """Map of a particle (None = the best) as a grid of its own; called at the end, and where `cells` is None."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FinalLoop:
    """A loop that a final pass found between two visits to the same walls."""

    kind: Literal["closed_by_filter", "left_open", "rejected"]
    """Whether the filter had closed it, or had left it open and the final pass has closed it; or whether the match was
    rejected, since the robot's motion or other loops contradict it."""
    before: Pose
    """Poses of the two visits before the final pass in the map's frame, (2, 3)."""
    after: Pose
    """The same after it, (2, 3)."""


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """Live viewers of a run, in addition to its recording; several can be combined."""

    window: bool = False
    """Open the native viewer."""
    serve: bool = False
    """Serve the web viewer on this machine's loopback address."""
    connect: str | None = None
    """Send to a viewer that is already there, e.g. rerun+http://127.0.0.1:9876/proxy."""

    def __post_init__(self) -> None:
        if self.connect is None:
            return
        parts = urlsplit(self.connect)
        if parts.scheme not in SCHEMES or not parts.hostname or parts.path != "/proxy":
            raise ValueError(
                f"not the address of a viewer: {self.connect!r}, expected e.g. rerun+http://127.0.0.1:9876/proxy"
            )


class View(Protocol):
    """A view of a run; a context manager that closes itself."""

    @property
    def address(self) -> str | None:
        """Address of the web page, where one is served."""

    def show(self, snapshot: Snapshot) -> None:
        """Show one scan. Its callables are called before this returns; those of the last snapshot also in `close`."""

    def finish(self, path: Pose, grid: OccupancyGrid, loops: Sequence[FinalLoop] = ()) -> None:
        """Show the path (scans, 3) and the map that a final pass made of the run, after the last snapshot.

        loops: those that it found
        """

    def close(self) -> None:
        """Complete the recording; returns soon, whatever the viewers do."""

    def wait(self) -> None:
        """After `close`: keep serving the web page until Ctrl-C; returns at once where none is served."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class NullView:
    """A view that does nothing, so that no caller has to check whether there is one."""

    address: str | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Do nothing."""

    def finish(self, path: Pose, grid: OccupancyGrid, loops: Sequence[FinalLoop] = ()) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def wait(self) -> None:
        """Return at once."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
