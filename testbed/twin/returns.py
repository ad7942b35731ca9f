# SPDX-License-Identifier: MIT
"""Beams that do not end on a wall of the twin's world: readings in front of it or beyond, and none where one was due.

They are kept as they were, for the twin to see in the same drive, and counted as rates, for other drives in its world.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.se2 import Pose
from testbed.frame_table import FrameTable
from testbed.simulation.physics._ray_kernels import cast_rays
from testbed.simulation.physics.fast import segment_grid
from testbed.simulation.robot.off_wall import OffWallBeams
from worlds import World

Floats = NDArray[np.float64]

OFF_WALL = 0.3
"""Readings farther than this from the wall are not of it [m]. With 0.1 m, walls that a scan sees where its pose is
wrong would count, too: the twin of ACES then has walls at two places."""
MAX_SCANS = 300
"""Scans that the rates are taken from, spread over the log."""
MAX_RATE = 0.2
"""Largest rate of readings in front of the walls [1/m]; with more the map is no map of the scans."""
MAX_LOST = 0.5
"""Largest share of beams without a reading."""
MAX_REACH = 1000.0
"""Rays end here where the lidar states no largest range [m]."""


class Returns(NamedTuple):
    """How often beams do not end on a wall."""

    short_rate: float
    """Rate of readings in front of the wall, per metre of beam [1/m]."""
    lost: float
    """Share of the beams that have no reading although a wall is in reach."""


class ComparedScan(NamedTuple):
    """A scan of the log, seen from its place in the twin's world."""

    origin: Floats
    """Position of the lidar [m], (2,)."""
    directions: Floats
    """Directions of the beams in the world [rad], (beams,)."""
    readings: Floats
    """What the log has [m], (beams,); inf = no return, NaN = lost."""
    due: Floats
    """Distances of the walls [m], (beams,); inf = none in reach."""

    def off_wall(self) -> NDArray[np.bool_]:
        """Tell which beams did not end on the wall that was due, (beams,)."""
        with np.errstate(invalid="ignore"):  # inf - inf: nothing was due, and nothing was seen
            near = np.abs(self.readings - self.due) <= OFF_WALL
        return ~near & (np.isfinite(self.due) | np.isfinite(self.readings))


def thinned(scans: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Return up to nearly twice as many scans as `most` of these (m,), evenly spread."""
    return scans[:: max(1, len(scans) // most)]


def compare_scans(world: World, table: FrameTable, path: Pose, scans: NDArray[np.int64]) -> Iterator[ComparedScan]:
    """Cast the beams of those scans in the twin's world, from the path `T_world_robot` (m, 3) of all scans."""
    walls = segment_grid(world.boundary_segments())
    for k in scans.tolist():
        scan = table.scan(k)
        x, y, theta = se2.compose(path[k], table.mounts[k]).tolist()
        directions = theta + np.asarray(scan.angles)
        low, high = table.range_limits[k].tolist()
        origins = np.full((directions.size, 2), (x, y))
        distances, _ = cast_rays(walls, origins, directions, min(high, MAX_REACH))
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        readings = np.where(ranges >= high, math.inf, np.where((ranges > 0.0) & (ranges >= low), ranges, math.nan))
        yield ComparedScan(origins[0], directions, readings, distances)


def measure_returns(compared: Iterator[ComparedScan], recorded: Floats, times: Floats) -> tuple[OffWallBeams, Returns]:
    """Return what the scans of the twin see off its walls, and how often beams do not end on one.

    compared: scans of the log, m; recorded (m,): their times [s]; times (k,): those of the scans of the twin, each of
    which sees what the scan of the log saw that is nearest in time
    """
    rows, sample = [], []
    for number, scan in enumerate(compared):
        off = scan.off_wall()
        rows.append(np.column_stack([np.tile(scan.origin, (off.sum(), 1)), scan.directions[off], scan.readings[off]]))
        if number % max(1, len(recorded) // MAX_SCANS) == 0:
            sample.append((scan.readings, scan.due))
    seen = [rows[k] for k in _nearest(recorded, times).tolist()]
    table = np.concatenate([np.empty((0, 4)), *seen])
    stamps = np.repeat(times, [len(part) for part in seen])
    beams = OffWallBeams(stamps=stamps, origins=table[:, :2], directions=table[:, 2], ranges=table[:, 3])
    return beams, returns_of(*(np.concatenate(parts) for parts in zip(*sample, strict=True)))


def _nearest(recorded: Floats, times: Floats) -> NDArray[np.intp]:
    """Return the index of the recorded time (m,), in any order, that is nearest to each time (k,)."""
    order = np.argsort(recorded, kind="stable")
    middles = 0.5 * (recorded[order][:-1] + recorded[order][1:])
    nearest: NDArray[np.intp] = order[np.searchsorted(middles, times)]
    return nearest


def returns_of(readings: Floats, due: Floats) -> Returns:
    """Return the rates from readings and distances of the walls [m], (n,) each, not finite for none.

    Readings beyond the walls show how often a wall is at a wrong place in the world; as many lie in front for that
    reason and are not counted. What is in front may stand anywhere on the beam with equal probability, as the simulator
    has it, so that those within `OFF_WALL` of the wall are taken to be as many as elsewhere.
    """
    there = np.isfinite(due)
    if not there.any():
        return Returns(0.0, 0.0)
    off, walls = np.where(np.isfinite(readings), readings, math.nan)[there] - due[there], due[there]
    short = float(np.mean(off < -OFF_WALL) - np.mean(off > OFF_WALL))
    rate = max(short, 0.0) / max(float(np.mean(np.maximum(walls - OFF_WALL, 0.0))), 1e-9)
    return Returns(min(rate, MAX_RATE), min(float(np.mean(np.isnan(off))), MAX_LOST))
