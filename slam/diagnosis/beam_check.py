# SPDX-License-Identifier: MIT
"""What a map says of the beams of a scan: do they end at its walls, and cross none before?

A robot that stands elsewhere than it believes sees through walls, or hits something where the map is free. Beams into
unknown space say nothing: a robot that drives into a new room contradicts no map.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slam import se2
from slam.diagnosis._beam_kernels import MET, SHORT, THROUGH, UNKNOWN, compare_beams
from slam.diagnosis.unheld_directions import Symmetric
from slam.grid.particle_maps import ParticleMaps
from slam.sensor.rays import Rays

CLEARANCE = 0.3
"""A beam and a wall contradict each other if they are farther apart than this [m]: the matcher's outlier distance,
several times the error of a reading."""
MIN_WALL_HITS = 3
"""A cell is a wall that no beam may cross if at least this many beams ended in it: a person is seen there for once."""
MIN_FREE_VISITS = 3
"""A cell is known to be free if at least this many beams reached it."""
MAX_BEAMS = 90
"""Beams of a scan that are compared at most; neighbours say the same."""


class BeamEvidence(NamedTuple):
    """How many of the compared beams, all of them hits, are of each kind."""

    met: int
    """They end at a wall of the map, and cross none before."""
    through: int
    """They cross a wall of the map."""
    short: int
    """They end in space that the map knows to be free."""
    unknown: int
    """They end where the map knows nothing."""

    @property
    def judged(self) -> int:
        """Beams of which the map says something."""
        return self.met + self.through + self.short

    @property
    def contradicting(self) -> int:
        """Beams that the map contradicts."""
        return self.through + self.short


class BeamLimits(NamedTuple):
    """When a beam and a map contradict each other."""

    occupied_share: float
    """Share of the beams that ended in a cell from which on it is a wall."""
    min_hits: int
    """Beams that ended in a wall, at least."""
    min_visits: int
    """Beams that reached a free cell, at least."""
    clearance: float
    """Distance between wall and end point from which on they contradict each other [cells]."""


def check_scan(maps: ParticleMaps, particle: int, pose: se2.Pose, rays: Rays) -> tuple[BeamEvidence, Symmetric]:
    """Compare a scan taken at the pose (3,) with the map of a particle, which must not hold the scan yet.

    Also returns the sum of n n^T over the beams that end at a piece of wall, of normal n in the map's frame.
    """
    return check_beams(maps, particle, pose, rays, every=max(1, -(-len(rays.hit) // MAX_BEAMS)))


def check_beams(
    maps: ParticleMaps, particle: int, pose: se2.Pose, rays: Rays, *, every: int, first: int = 0
) -> tuple[BeamEvidence, Symmetric]:
    """The same for every k-th beam, from beam `first` on."""
    limits = BeamLimits(maps.config.occupied_share, MIN_WALL_HITS, MIN_FREE_VISITS, CLEARANCE / maps.config.cell)
    kinds, normals = np.empty(len(rays.hit), np.uint8), np.empty(3)
    compare_beams(maps.grids, particle, np.asarray(pose, dtype=np.float64), rays, every, first, limits, kinds, normals)
    looked_at = kinds[first::every][rays.hit[first::every]]
    counts = np.bincount(looked_at, minlength=4)
    xx, xy, yy = normals.tolist()
    return BeamEvidence(*(int(counts[kind]) for kind in (MET, THROUGH, SHORT, UNKNOWN))), (xx, xy, yy)
