# SPDX-License-Identifier: MIT
"""Beams that do not end on a wall: readings in front of it, and none where one was due, as rates for the simulator."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.se2 import Pose
from testbed.frame_table import FrameTable
from testbed.simulation.physics._ray_kernels import cast_rays
from testbed.simulation.physics.fast import segment_grid
from worlds import World

Floats = NDArray[np.float64]

OFF_WALL = 0.3
"""Readings farther than this from the wall are not of it [m]."""
MAX_SCANS = 300
"""Scans that are compared with the world, spread over the log."""
MAX_RATE = 0.2
"""Largest rate of readings in front of the walls [1/m]; with more the map is no map of the scans."""
MAX_LOST = 0.5
"""Largest share of beams without a reading."""


class Returns(NamedTuple):
    """How often beams do not end on a wall."""

    short_rate: float
    """Rate of readings in front of the wall, per metre of beam [1/m]."""
    lost: float
    """Share of the beams that have no reading although a wall is in reach."""


def measure_returns(world: World, table: FrameTable, path: Pose) -> Returns:
    """Compare scans with the walls of the twin's world, seen from the path `T_world_robot` (m, 3) of all scans.

    Readings beyond the walls show how often a wall is at a wrong place in the world; as many lie in front for that
    reason and are not counted. What is in front may stand anywhere on the beam with equal probability, as the simulator
    has it, so that those within `OFF_WALL` of the wall are taken to be as many as elsewhere.
    """
    walls = segment_grid(world.boundary_segments())
    sample = np.arange(0, len(table.scan_rows), max(1, len(table.scan_rows) // MAX_SCANS))
    readings, due = [], []
    for k in sample.tolist():
        scan = table.scan(k)
        x, y, theta = se2.compose(path[k], table.mounts[k]).tolist()
        directions = theta + np.asarray(scan.angles)
        high = float(table.range_limits[k, 1])
        distances, _ = cast_rays(walls, np.full((directions.size, 2), (x, y)), directions, min(high, 1000.0))
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        readings.append(np.where((ranges > 0.0) & (ranges < high), ranges, np.nan))
        due.append(distances)
    return returns_of(np.concatenate(readings), np.concatenate(due))


def returns_of(readings: Floats, due: Floats) -> Returns:
    """Return the rates from readings, NaN for none, and distances of the walls, inf for none [m], (n,) each."""
    there = np.isfinite(due)
    if not there.any():
        return Returns(0.0, 0.0)
    off, walls = readings[there] - due[there], due[there]
    short = float(np.mean(off < -OFF_WALL) - np.mean(off > OFF_WALL))
    rate = max(short, 0.0) / max(float(np.mean(np.maximum(walls - OFF_WALL, 0.0))), 1e-9)
    return Returns(min(rate, MAX_RATE), min(float(np.mean(np.isnan(off))), MAX_LOST))
