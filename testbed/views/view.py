# SPDX-License-Identifier: MIT
"""The data that a run shows, the interface of a view that takes them, and a view that does nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose
from slam.step.step_report import StepReport

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
    robot_urdf: str | None = None
    """The robot as URDF text, base_link on the floor, x forward; None = a disc of `robot_radius` is drawn."""
    robot_radius: float = 0.2
    """Radius of the robot [m]; also the length of its heading arrow."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """What is known at one scan. Poses of the estimate are in the map's frame, those of the odometry in its own, the
    truth in the world's: a view lays them on top of each other at the first snapshot."""

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
    proposal_samples: Pose | None = None
    """The K poses that were drawn about the optimum of the best particle, (K, 3), map's frame."""
    collided: bool = False
    """Whether the robot has touched something."""
    notes: tuple[str, ...] = ()
    """Further lines for the event log."""
    path: Callable[[int | None], Pose] | None = None
    """Path of a particle (None = the best) through all updates, (updates, 3); asked for about once a second."""
    map: Callable[[int | None], OccupancyGrid] | None = None
    """Map of a particle (None = the best); asked for about once a second, and once more at the end."""


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """Where a run can be watched while it goes on, beside its recording; several at once."""

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
        """Show one scan. The snapshot's callables are called before this returns; those of the last one in `close`."""

    def finish(self, path: Pose, grid: OccupancyGrid) -> None:
        """Replace path (scans, 3) and map by the result of a final pass, once all snapshots were shown."""

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

    def finish(self, path: Pose, grid: OccupancyGrid) -> None:
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
