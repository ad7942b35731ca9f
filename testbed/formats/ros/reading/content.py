# SPDX-License-Identifier: MIT
"""What is read of a bag, before it becomes a log."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam.occupancy import OccupancyGrid
from testbed.formats.log import Topic
from testbed.formats.ros.reading.decode import NO_TRACK, Track
from testbed.formats.ros.reading.raw_scans import RawScans, ScanStore
from testbed.formats.ros.reading.transforms import Moving, Transforms

Heights = tuple[float, float]
"""Lowest and highest point of a slice, above the robot's frame [m]."""


class Selection(NamedTuple):
    """What is read of a bag that holds more."""

    heights: Heights | None = None
    """The slice of point clouds that becomes scans; None = there are scans."""
    namespace: str | None = None
    """What the topics and frames of the robot begin with, where there are several robots."""
    topics: tuple[str, ...] = ()
    """Topics that the user chose: others of their types are not read."""


WHOLE = Selection()


@dataclass
class BagContent:
    """Topics, messages and transforms of a bag that is being read."""

    laser_offset: float | None = None
    """The lidar's place ahead of the robot's centre as the user gave it [m]."""
    selection: Selection = WHOLE
    """What is read of it."""
    cloud_frames: dict[str, str] = field(default_factory=dict)
    """Frame of the point clouds of each topic."""
    level_mounts: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    """`T_robot_lidar` of the scans that are slices, by the frame of the clouds [m, m, rad]."""
    notes: list[str] = field(default_factory=list)
    """What was found and mended, for the user."""
    topics: dict[str, str] = field(default_factory=dict)
    """Topics of odometry, truth, commands and map, as far as there are any."""
    all_topics: list[Topic] = field(default_factory=list)
    """Every topic, with what it is read for."""
    others: list[str] = field(default_factory=list)
    """Topics that are left out, as the user reads them."""
    scans: dict[str, RawScans] = field(default_factory=dict)
    """The scans of each topic."""
    scan_store: ScanStore = field(default_factory=ScanStore)
    """What they share."""
    odometry: Track = NO_TRACK
    truth: Track = NO_TRACK
    commands: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    """Stamp [s], speed [m/s], turn rate [rad/s], in the order of the bag."""
    transforms: Transforms = field(default_factory=Transforms)
    moving: Moving = field(default_factory=Moving)
    """Transforms of topics that are not static; only read where odometry or mounts are nowhere else."""
    clock_offset: float = 0.0
    """How far the bag's own times lie behind the stamps of odometry [s]."""
    scan_clock_offset: float = 0.0
    """How far they lie behind the stamps of the scans [s]."""
    truth_map: OccupancyGrid | None = None
    robot_urdf: str | None = None
    messages: int = 0


class RawMessage(NamedTuple):
    """A serialised message."""

    number: int
    """Counts the messages that are read, from 1."""
    time: int
    """Time of the bag [ns]."""
    data: bytes
