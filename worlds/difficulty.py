# SPDX-License-Identifier: MIT
"""Measure on a world's geometry how hard it is to map."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry import LineString

from worlds.errors import WorldError
from worlds.raster import TrueMap, true_map
from worlds.world import Difficulty, World

_BEAMS, _REACH, _LIDAR_HEIGHT = 180, 12.0, 0.2
"""Number of beams, range [m] and height [m] of the lidar that measures: a small one."""
_POSES_EVERY = 1.0
"""Distance along the tour between the positions that are measured [m]."""
_MIN_LOOP = 4.0
"""Shortest outline of an island that counts as a loop [m]; columns do not."""
_MIN_OBSERVABILITY = 0.1
"""Below this observability a scan hardly constrains one direction: such positions count as corridor."""


def measure_difficulty(world: World) -> Difficulty:
    """Measure a world with a lidar of 180 beams and 12 m on its tour. Raises `WorldError` if the outline is open."""
    floor = world.free_space()
    if floor is None:
        raise WorldError(f"world {world.name!r}: the start is not enclosed, expected a closed outline")
    path = LineString(world.path()) if world.tour is not None else None
    length = 0.0 if path is None else path.length
    at = np.array([[world.start.x, world.start.y]])
    if path is not None:
        at = shapely.get_coordinates(path.interpolate(np.arange(0.0, length, _POSES_EVERY)))
    segments = world.boundary_segments(_LIDAR_HEIGHT, glass=False)
    seen = np.array([observability(segments, position) for position in at])
    islands = [hole for hole in floor.interiors if hole.length >= _MIN_LOOP]
    return Difficulty(
        area=round(floor.area, 1),
        free_share=round(floor.area / shapely.Polygon(floor.exterior).area, 3),
        loops=len(islands),
        tour_length=round(length, 1),
        observability=round(float(np.median(seen)), 3),
        corridor_share=round(float((seen < _MIN_OBSERVABILITY).mean()), 3),
        symmetry=round(_symmetry(true_map(world, 0.1, height=_LIDAR_HEIGHT)), 3),
    )


def observability(segments: NDArray[np.float64], position: NDArray[np.float64]) -> float:
    """Return how well one scan at `position` (2,) [m] among `segments` (n, 4) [m] constrains it, 0 to 1."""
    directions = np.arange(_BEAMS) * (2.0 * np.pi / _BEAMS)
    u = np.stack([np.cos(directions), np.sin(directions)], axis=-1)[:, None]
    a, e = segments[:, :2] - position, segments[:, 2:] - segments[:, :2]
    across = u[..., 0] * e[:, 1] - u[..., 1] * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (a[:, 0] * e[:, 1] - a[:, 1] * e[:, 0]) / across
        share = (a[:, 0] * u[..., 1] - a[:, 1] * u[..., 0]) / across
    along = np.where((along >= 0.0) & (share >= 0.0) & (share <= 1.0), along, np.inf)
    first = np.argmin(along, axis=1)
    hit = along[np.arange(_BEAMS), first] <= _REACH
    wall = e[first[hit]]
    normals = np.stack([-wall[:, 1], wall[:, 0]], axis=-1) / np.hypot(wall[:, 0], wall[:, 1])[:, None]
    return float(2.0 * np.linalg.eigvalsh(normals.T @ normals / _BEAMS)[0])


def _symmetry(truth: TrueMap) -> float:
    """Return the largest share of wall cells that a turned or mirrored map puts on, or next to, wall cells."""
    rows, cols = np.nonzero(truth.occupied)
    walls = truth.occupied[rows.min() : rows.max() + 1, cols.min() : cols.max() + 1]
    near = ndimage.binary_dilation(walls, np.ones((3, 3), dtype=np.bool_))
    turned = (walls[::-1, ::-1], walls[::-1], walls[:, ::-1])
    return max(float(near[other].mean()) for other in turned)
