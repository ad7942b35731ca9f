# SPDX-License-Identifier: MIT
"""Measure walls in metres: distance from the true ones, thickness, doubles and missing ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from eval.map.grids import cell_centres, lookup
from slam.occupancy import OccupancyGrid
from slam.se2 import inverse, transform_points

TRIM = 0.1
"""Share of the largest distances that the trimmed mean leaves out."""
REACH = 0.5
"""Distance to both sides of a true wall, along its normal, within which walls of the map are found [m]."""
MAX_PLACES = 4000
"""Largest number of places on true walls that are cut; more are thinned out evenly."""
_STRAIGHT = 0.8
"""Smallest coherence of the structure tensor of a straight wall; corners and ends are below."""


@dataclass(frozen=True)
class WallDistance:
    """Distances of the walls of one map to those of another [m]."""

    mean: float
    trimmed_mean: float
    p95: float


@dataclass(frozen=True)
class WallProfile:
    """Walls of the map along the normals of the true walls."""

    double_wall_rate: float | None
    """Share of the places with more walls along the normal than in truth, 0 to 1; None without places."""
    wall_thickness_m: float | None
    """Mean thickness of the map's walls [m]; None without places."""
    true_wall_thickness_m: float
    """Mean thickness of the true map's walls on its own cells [m]: that of a perfect map."""
    places: int
    """Number of places on straight true walls where the map shows a wall."""
    missing_wall_rate: float
    """Share of the places on straight true walls where the map shows none within `REACH`, 0 to 1."""


def wall_distances(
    grid: OccupancyGrid, truth: OccupancyGrid, T_truth_grid: ArrayLike, observable: NDArray[np.bool_]
) -> tuple[WallDistance, WallDistance] | None:
    """Return distances of the map's occupied cells to the nearest true ones, and of observable true ones to the map's.

    Distances are between nearest cell centres, exact under rotation; the results are their mean, the mean without the
    largest tenth, and the 95th percentile. Unit m, range 0 and up; a perfect map on other cells has about a quarter of
    a cell. Returns None where the map or the truth has no wall. Source: Santos, Portugal, Rocha, SSRR 2013, both ways.
    Trap: the first direction alone does not show missing walls, the second alone does not show invented ones.
    """
    found = transform_points(T_truth_grid, cell_centres(grid, grid.occupied))
    all_true = cell_centres(truth, truth.occupied)
    visible = cell_centres(truth, truth.occupied & observable)
    if len(found) == 0 or len(visible) == 0:
        return None
    to_truth, from_truth = cKDTree(all_true).query(found)[0], cKDTree(found).query(visible)[0]
    return _distance(np.asarray(to_truth)), _distance(np.asarray(from_truth))


def wall_profile(
    grid: OccupancyGrid, truth: OccupancyGrid, T_truth_grid: ArrayLike, observable: NDArray[np.bool_]
) -> WallProfile | None:
    """Cut the map along the normals of the straight, observable true walls.

    Each cut runs from -`REACH` to +`REACH` in half cells. Two walls are separate if free ground lies between them;
    specks that noise leaves within and behind a wall have none in front of them. A place is double if the map has more
    walls on the cut than the truth, whose cut is two cells longer, so that a wall at its end is not counted as false.
    The thickness is that of the wall nearest to the true one. Returns None where there is no straight wall. Rates have
    no unit, 0 to 1; thickness in m, from half a cell up. It measures "ghosting" after bad loop closures; no published
    measure is known to us. Trap: ghosts nearer than a cell show as thickness, those beyond `REACH` not at all (the
    wall distance shows them).
    """
    wall, normal = _straight_walls(truth, observable)
    if len(wall) == 0:
        return None
    cell = truth.resolution
    steps = 2 * int(np.ceil(REACH / cell))
    wide = 0.5 * cell * (np.arange(-steps - 4, steps + 4, dtype=np.float64) + 0.5)  # two per cell, none on an edge
    offsets = wide[4:-4]
    T_grid_truth = inverse(T_truth_grid)

    def cut(of: OccupancyGrid, at: NDArray[np.float64], T: ArrayLike) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        points = wall[:, None, :] + at[None, :, None] * normal[:, None, :]
        values = lookup(of, transform_points(T, points.reshape(-1, 2))).reshape(len(wall), len(at))
        return values > OccupancyGrid.OCCUPIED, values < OccupancyGrid.FREE

    found, found_free = cut(grid, offsets, T_grid_truth)
    true, true_free = cut(truth, wide, np.zeros(3))
    shown = found.any(axis=1)
    if not shown.any():
        return WallProfile(None, None, _thickness(true, wide, cell), 0, 1.0)
    double = _walls(found, found_free) > _walls(true, true_free)
    return WallProfile(
        double_wall_rate=float(double[shown].mean()),
        wall_thickness_m=_thickness(found[shown], offsets, cell),
        true_wall_thickness_m=_thickness(true[shown], wide, cell),
        places=int(shown.sum()),
        missing_wall_rate=float(1.0 - shown.mean()),
    )


def _distance(distances: NDArray[np.float64]) -> WallDistance:
    kept = np.sort(distances)[: max(1, int(np.ceil((1.0 - TRIM) * len(distances))))]
    return WallDistance(float(distances.mean()), float(kept.mean()), float(np.percentile(distances, 95.0)))


def _straight_walls(
    truth: OccupancyGrid, observable: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return centres (k, 2) [m] and unit normals (k, 2), map frame, of up to `MAX_PLACES` cells of straight true walls.

    Normals come from the structure tensor of the free space (Bigün and Granlund, ICCV 1987), which also works for a
    wall with free space on both sides, where the gradients themselves cancel.
    """
    free = ndimage.gaussian_filter(truth.free.astype(np.float32), 1.0)
    gy, gx = np.gradient(free)
    xx, xy, yy = (ndimage.gaussian_filter(product, 3.0) for product in (gx * gx, gx * gy, gy * gy))
    spread = np.hypot(xx - yy, 2.0 * xy)
    straight = truth.occupied & observable & (spread > _STRAIGHT * (xx + yy)) & (xx + yy > 0.0)
    rows, cols = np.nonzero(straight)
    step = max(1, -(-len(rows) // MAX_PLACES))
    rows, cols = rows[::step], cols[::step]
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)[rows, cols] + truth.origin[2]
    centres = transform_points(np.asarray(truth.origin), (np.column_stack([cols, rows]) + 0.5) * truth.resolution)
    return centres, np.column_stack([np.cos(angle), np.sin(angle)])


def _walls(occupied: NDArray[np.bool_], free: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Count the walls on each cut (k, samples), (k,): occupied samples with free ones between them."""
    known = np.where(occupied | free, np.arange(occupied.shape[1]), -1)
    last_known = np.maximum.accumulate(known, axis=1)[:, :-1]
    after_wall = np.take_along_axis(occupied, np.maximum(last_known, 0), axis=1) & (last_known >= 0)
    begins = occupied.copy()
    begins[:, 1:] &= ~after_wall
    walls: NDArray[np.intp] = begins.sum(axis=1)
    return walls


def _thickness(cuts: NDArray[np.bool_], offsets: NDArray[np.float64], cell: float) -> float:
    """Return the mean thickness [m] of the wall nearest to the centre of each cut that has one."""
    rows = np.flatnonzero(cuts.any(axis=1))
    if len(rows) == 0:
        return 0.0
    cuts = cuts[rows]
    nearest = np.argmin(np.where(cuts, np.abs(offsets), np.inf), axis=1)
    # A sample belongs to the wall of `nearest` if no gap lies between them: the number of gaps so far is equal.
    gaps = np.cumsum(~cuts, axis=1)
    own = cuts & (gaps == gaps[np.arange(len(cuts)), nearest][:, None])
    return float(own.sum(axis=1).mean() * 0.5 * cell)
