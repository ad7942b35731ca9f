# SPDX-License-Identifier: MIT
"""Beams of a recorded drive that did not end on a wall, laid over the scans of a simulated one.

People, things that stood there only once, doors that were open, glass: what a lidar sees of them hides many
neighbouring beams of several scans, and always the same ones of a drive. Readings that are drawn beam by beam, as
`LidarPreset.short_return_rate` has them, are easier for SLAM.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam.se2 import wrap_angle
from testbed.simulation.physics.backend import Hits

Floats = NDArray[np.float64]

SAME_TIME = 1e-3
"""A scan is the one of a stamp if its first beam is measured this close to it [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OffWallBeams:
    """`n` beams, in the world's frame, in the order of their stamps."""

    stamps: Floats
    """Time of the scan after the beginning of the drive [s], (n,)."""
    origins: Floats
    """Position of the lidar [m], (n, 2)."""
    directions: Floats
    """Direction of the beam [rad], (n,)."""
    ranges: Floats
    """Where it ended [m], (n,); inf = no return, NaN = lost."""

    def over(self, hits: Hits, stamp: float, origins: Floats, directions: Floats) -> Hits:
        """Return the hits of one scan of at least two beams with these beams in place of those next to them.

        stamp: time of its first beam [s]; origins (beams, 2) [m], directions (beams,) [rad]: its beams

        A robot that drives a little beside the recorded drive sees the same end points: a beam is replaced by the one
        whose end lies in its direction, to half the angle between two beams; where several do, by the nearest of them.
        Beams without an end keep their direction.
        """
        first, last = np.searchsorted(self.stamps, [stamp - SAME_TIME, stamp + SAME_TIME]).tolist()
        if first == last:
            return hits
        ranges = self.ranges[first:last]
        there, towards = np.isfinite(ranges), self.directions[first:last].copy()
        heading = np.stack([np.cos(towards[there]), np.sin(towards[there])], axis=1)
        ends = self.origins[first:last][there] + ranges[there, None] * heading
        towards[there] = np.arctan2(*(ends - origins[len(origins) // 2]).T[::-1])
        away = np.abs(wrap_angle(towards[:, None] - directions))
        beams, half = np.argmin(away, axis=1), 0.5 * abs(float(np.median(np.diff(directions))))
        distances, incidence = hits.distances.copy(), hits.cos_incidence.copy()
        seen = ranges.copy()
        seen[there] = np.hypot(*(ends - origins[beams[there]]).T)
        order = np.argsort(np.where(np.isnan(seen), math.inf, seen), kind="stable")[::-1]  # the nearest come last
        order = order[np.min(away, axis=1)[order] <= half]
        distances[beams[order]], incidence[beams[order]] = seen[order], 1.0
        return Hits(distances, incidence)
