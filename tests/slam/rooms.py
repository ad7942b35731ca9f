# SPDX-License-Identifier: MIT
"""A room whose walls are parallel to no axis, exact scans in it, and what tests read out of the maps."""

import math

import numpy as np

from slam import Scan, se2
from slam._threads import Threads
from slam.config import MapConfig
from slam.grid._cell_kernels import VISITS, hits_of
from slam.grid.particle_maps import ParticleMaps
from slam.sensor.rays import Rays

CORNERS = se2.transform_points(
    (0.0, 0.0, 0.3), np.array([(-2.0, -1.5), (4.0, -1.5), (4.0, 1.5), (1.5, 1.5), (1.5, 3.5), (-2.0, 3.5)])
)
"""An L of 6 m by 5 m about the origin, turned by 0.3 rad."""


def noisy_odometry(truth, rng):
    """Odometry (n, 3) of a drive (n, 3) with noise of 1 cm, 5 mm and 0.006 rad in each step."""
    motions = se2.between(truth[:-1], truth[1:]) + rng.normal(scale=(0.01, 0.005, 0.006), size=(len(truth) - 1, 3))
    odometry = np.zeros_like(truth)
    for k, motion in enumerate(motions):
        odometry[k + 1] = se2.compose(odometry[k], motion)
    return odometry


def closed(corners):
    """Walls (n, 4) through corners (n, 2) and back to the first."""
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


WALLS = closed(CORNERS)

MOUNT = (0.1237, 0.0271, 0.05)
"""Where the lidar sits on the robot: off the corners of cells, where it is a matter of taste what a beam crosses."""


def scan_at(pose, *, beams=60, mount=MOUNT, stamp=0.0, noise=0.0, rng=None, walls=None):
    """Scan of the room by a robot at `pose` (3,), all around; `noise` [m] is the standard deviation of the ranges."""
    angles = np.linspace(-np.pi, np.pi, beams, endpoint=False) + 0.013
    lidar = se2.compose(pose, mount)
    direction = np.stack([np.cos(lidar[2] + angles), np.sin(lidar[2] + angles)], axis=-1)[:, None]
    walls = WALLS if walls is None else walls
    along, away = walls[:, 2:] - walls[:, :2], walls[:, :2] - lidar[:2]
    cross = direction[..., 0] * along[:, 1] - direction[..., 1] * along[:, 0]
    distance = (away[:, 0] * along[:, 1] - away[:, 1] * along[:, 0]) / cross
    share = (away[:, 0] * direction[..., 1] - away[:, 1] * direction[..., 0]) / cross
    ranges = np.where((distance > 0.0) & (share >= 0.0) & (share <= 1.0), distance, np.inf).min(axis=1)
    if noise > 0.0:
        ranges = ranges + noise * rng.standard_normal(beams)
    return Scan(ranges=ranges, angles=angles, range_max=20.0, mount=mount, stamp=stamp)


def drive(steps, *, distance=0.3, turn=0.12):
    """True poses (steps + 1, 3) on an arc from the origin."""
    poses = np.zeros((steps + 1, 3))
    for k in range(steps):
        poses[k + 1] = se2.compose(poses[k], (distance, 0.0, turn))
    return poses


def rays(ends, hit=True, origin=(0.0, 0.0)):
    """Rays of one lidar at `origin` (2,) to ends (n, 2)."""
    ends = np.atleast_2d(np.asarray(ends, dtype=np.float64))
    return Rays(np.broadcast_to(origin, ends.shape).astype(np.float64), ends, np.broadcast_to(hit, len(ends)).copy())


def empty_maps(particles=1, threads=1, **changes):
    return ParticleMaps(particles, MapConfig(**changes), Threads(threads))


def dense(table, data):
    """One particle's cells as a plain array (rows, columns), from its table and the pool's data."""
    side = math.isqrt(data.shape[1])
    tiles = data[table].reshape(*table.shape, side, side)
    return tiles.swapaxes(1, 2).reshape(table.shape[0] * side, table.shape[1] * side)


def counts_of(maps, particle=0):
    """Hits, visits and wall flags of one particle's cells, (rows, columns) each."""
    table = maps.grids.table[particle]
    words = dense(table, maps.grids.counts)
    used, place = np.unique(table, return_inverse=True)  # of the whole pool, which is large
    walls = np.unpackbits(maps.grids.walls[used].view(np.uint8), axis=1, bitorder="little")
    return hits_of(words), words & VISITS, dense(place.reshape(table.shape), walls) == 1


def word_at(maps, name, point, particle=0):
    """The word of the grid `name` at a point (2,) [m] of the map's frame."""
    table = {"counts": maps.grids.table, "surface": maps.grids.surface_table, "nearest": maps.grids.field_table}[name]
    cx, cy = np.floor(np.asarray(point) / maps.grids.cell).astype(int) - maps.grids.corner
    return dense(table[particle], getattr(maps.grids, name))[cy, cx]
