# SPDX-License-Identifier: MIT
"""The map of a finished run: every reading that belongs to a piece of wall ends on that wall.

A cell behind a wall is reached by none but readings that are too long, all of which end there or beyond: a count of
ends and passes takes it for a wall, and walls grow thick on their far side. Once the walls are known as lines, an end
point with covariance C about its own true place has, given that this place lies on the line n . p = o, the mean

    p - C n (n . p - o) / (n^T C n)

(the update of a Kalman filter by a measurement without noise; Thrun, Burgard, Fox 2005, table 3.1). C is that of the
final pass (`slam.refinement.noise`): a floor in all directions and shares of the range along and across the beam, so an
end point whose range errs most moves along its beam, a near one across the wall. End points without a wall stay where
they are.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

import numpy as np

from slam import se2
from slam._threads import Threads
from slam.config import FilterConfig, RefineConfig
from slam.grid.particle_maps import ParticleMaps
from slam.occupancy import OccupancyGrid
from slam.refinement._redraw_kernels import SNAP_SIGMAS, move_onto_walls
from slam.refinement.noise import Noise
from slam.refinement.surfels import Cells, Surfels, make_cloud, transform_cloud
from slam.sensor.rays import Rays

DEPTH = 0.1
"""How far end points are put into their wall, in cells: they lie on its face, and where that is the border of two
cells, the one behind is solid."""
NOISE_RANGE_LIMIT = 10.0
"""Range limit [m]: up to here an end point finds its wall wherever noise may have put it; beyond, only a near wall."""
BATCH = 512
"""Scans whose end points are moved at once: enough to keep the threads busy, and little memory."""


def max_snap_distance(config: RefineConfig, noise: Noise) -> float:
    """Largest distance of an end point from the point of its surfel [m]."""
    variance = noise.floor + noise.shared + max(noise.along, noise.across) * NOISE_RANGE_LIMIT**2
    return config.spacing + config.last_gate + SNAP_SIGMAS * float(np.sqrt(variance))


def redraw_map(
    poses: se2.Pose,
    rays: Mapping[int, Rays],
    walls: tuple[Cells, Surfels],
    noise: Noise,
    config: FilterConfig,
    threads: Threads,
) -> OccupancyGrid:
    """The map of all scans.

    poses (frames, 3);  rays: those of the scan of each frame that has one;  walls: as found at these poses
    """
    maps = ParticleMaps(1, config.map, threads)
    frames = list(rays)
    for begin in range(0, len(frames), BATCH):
        batch = frames[begin : begin + BATCH]
        moved = snap_to_walls([rays[i] for i in batch], poses[batch], walls, noise, config, threads)
        for frame, ray in zip(batch, moved, strict=True):
            maps.integrate_scan(poses[frame : frame + 1], ray)
    return maps.occupancy(0)


def snap_to_walls(
    rays: Sequence[Rays],
    poses: se2.Pose,
    walls: tuple[Cells, Surfels],
    noise: Noise,
    config: FilterConfig,
    threads: Threads,
) -> list[Rays]:
    """Rays of scans at poses (scans, 3), the end points of hits moved onto the walls that they belong to."""
    cells, surfels = walls
    cloud, settings = make_cloud(rays, max_points=sys.maxsize), config.refine
    there = transform_cloud(cloud, poses, threads)
    belongs = noise, settings.spacing, settings.last_gate
    depth = DEPTH * config.map.cell
    threads.run(move_onto_walls, len(cloud.ends), there, cloud.ranges, cells, surfels, *belongs, depth)
    moved = []
    for i, ray in enumerate(rays):
        ends = ray.ends.copy()
        in_map = there.points[cloud.first[i] : cloud.first[i + 1]]
        ends[ray.hit] = se2.transform_points(se2.inverse(poses[i]), in_map)
        moved.append(ray._replace(ends=ends))
    return moved
