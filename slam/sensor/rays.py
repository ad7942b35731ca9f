# SPDX-License-Identifier: MIT
"""Rays from scans in the robot's frame: readings sorted by kind, the motion during the scan undone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam import se2
from slam.scan import Scan
from slam.sensor.deskew import deskewed_mounts
from slam.sensor.possible_motion import possible_twist


class Rays(NamedTuple):
    """The beams of one scan in the robot's frame at the time of the scan."""

    origins: NDArray[np.float64]
    """Where each beam starts [m], (beams, 2)."""
    ends: NDArray[np.float64]
    """Where each beam ends [m], (beams, 2)."""
    hit: NDArray[np.bool_]
    """Whether it ended on something, (beams,)."""


class BeamCounts(NamedTuple):
    """How many readings of a scan are of each kind; `Scan` defines the kinds."""

    hits: int
    """Readings within the lidar's range."""
    no_returns: int
    """Readings at or beyond its range, infinity included."""
    invalid: int
    """NaN, zero, negative, below its range, or without a direction or time: they carry no information."""


def count_beams(scans: Sequence[Scan]) -> BeamCounts:
    """Count the readings of one or several lidars by kind."""
    total = hits = no_returns = 0
    for scan in scans:
        aimed = _aimed(scan)
        total += len(scan.ranges)
        hits += int(np.count_nonzero(scan.hit & aimed))
        no_returns += int(np.count_nonzero(scan.no_return & aimed))
    return BeamCounts(hits, no_returns, total - hits - no_returns)


def _aimed(scan: Scan) -> NDArray[np.bool_]:
    """Whether the direction and the time of each beam are known, (beams,)."""
    aimed: NDArray[np.bool_] = np.isfinite(scan.angles)
    return aimed if scan.time_offsets is None else aimed & np.isfinite(scan.time_offsets)


def make_rays(
    scans: Sequence[Scan],
    *,
    usable_range: float,
    free_range: float = 0.0,
    twist: ArrayLike | None = None,
    reference: float | None = None,
) -> Rays:
    """Rays of one or several lidars in the robot's frame at time `reference` [s], else at the first scan's first beam.

    Hits beyond `usable_range` [m] count as no returns; these become rays without a hit up to `free_range` [m], or are
    left out where it is 0; invalid readings are left out. With a `twist` `(vx, vy, omega)` [m/s, m/s, rad/s] the
    robot's motion between the beams is undone wherever a scan knows its beams' times. A twist that no robot reaches
    undoes nothing: wheels that slip within a scan report turns by which it would be bent by tens of degrees.
    """
    twist = possible_twist(twist)
    time = scans[0].stamp if reference is None else reference
    parts = [_rays_of_one(scan, usable_range, free_range, twist, time) for scan in scans]
    if len(parts) == 1:
        return parts[0]
    return Rays(
        origins=np.concatenate([p.origins for p in parts]),
        ends=np.concatenate([p.ends for p in parts]),
        hit=np.concatenate([p.hit for p in parts]),
    )


def _rays_of_one(scan: Scan, usable_range: float, free_range: float, twist: ArrayLike | None, reference: float) -> Rays:
    aimed = _aimed(scan)
    hit = used = scan.hit & aimed & (scan.ranges <= usable_range)
    lengths = scan.ranges
    if free_range > 0.0:
        used = hit | aimed & (scan.no_return | scan.hit)
        lengths = np.where(hit, scan.ranges, min(free_range, scan.range_max))
    length, angles = lengths[used], scan.angles[used]
    in_lidar = np.empty((length.size, 2))
    in_lidar[:, 0], in_lidar[:, 1] = length * np.cos(angles), length * np.sin(angles)
    mount = np.asarray(scan.mount, dtype=np.float64)
    if twist is None or scan.time_offsets is None:
        return Rays(
            origins=np.full((length.size, 2), mount[:2]), ends=se2.transform_points(mount, in_lidar), hit=hit[used]
        )
    T_robot_lidar = deskewed_mounts(mount, twist, scan.stamp - reference + scan.time_offsets[used])
    ends = se2.transform_points(T_robot_lidar, in_lidar[:, None, :])[:, 0, :]
    return Rays(origins=np.ascontiguousarray(T_robot_lidar[:, :2]), ends=ends, hit=hit[used])
