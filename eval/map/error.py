# SPDX-License-Identifier: MIT
"""All measures of one map against the truth, under one alignment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eval.map.exact_walls import ExactWallError, exact_wall_error
from eval.map.grids import cell_centres, lookup, resample
from eval.map.overlap import Overlap, coverage, free_overlap, occupied_overlap
from eval.map.probability import ProbabilityScore, probability_score
from eval.map.walls import WallDistance, WallProfile, wall_distances, wall_profile
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, transform_points

TOLERANCES = (0, 1, 2)
"""Distances within which a cell counts as right [cells]."""


@dataclass(frozen=True, eq=False)
class MapError:
    """All measures of one map; the function that computes a measure explains it."""

    T_truth_grid: Pose
    """The alignment under which it was measured, (3,)."""
    occupied: tuple[Overlap, ...]
    """Occupied cells, for each of `TOLERANCES`."""
    free: tuple[Overlap, ...]
    """Free cells, for each of `TOLERANCES`."""
    to_truth: WallDistance | None
    """Distances of the map's walls to the nearest true ones; None where either map has no wall."""
    from_truth: WallDistance | None
    """Distances of the observable true walls to the map's."""
    profile: WallProfile | None
    exact_walls: ExactWallError | None
    """None also where the exact true walls are unknown."""
    probability: ProbabilityScore | None
    coverage: float | None

    @property
    def wall_distance(self) -> float | None:
        """Mean of both directions [m]; None where either map has no wall."""
        if self.to_truth is None or self.from_truth is None:
            return None
        return 0.5 * (self.to_truth.mean + self.from_truth.mean)


def map_error(
    grid: OccupancyGrid,
    truth: OccupancyGrid,
    T_truth_grid: ArrayLike,
    observable: NDArray[np.bool_],
    walls: NDArray[np.float64] | None = None,
) -> MapError:
    """Measure `grid` against `truth` (1 occupied, 0 free, NaN unknown) with `grid` moved by `T_truth_grid` (3,).

    Cell measures use the cells of the truth (`eval.map.grids.resample`), wall measures the walls themselves.
    `observable` (rows, cols): cells that could have been seen (`eval.map.observability`). `walls`: the exact true walls
    `(x0, y0, x1, y1)` [m], (n, 4), where they are known.
    """
    drawn = resample(grid, truth, T_truth_grid)
    per_cell = (grid.resolution / truth.resolution) ** 2
    off_occupied, off_free = (
        round(per_cell * _cells_outside(grid, mask, truth, T_truth_grid)) for mask in (grid.occupied, grid.free)
    )
    distances = wall_distances(grid, truth, T_truth_grid, observable)
    return MapError(
        T_truth_grid=np.asarray(T_truth_grid, dtype=np.float64),
        occupied=tuple(
            occupied_overlap(drawn, truth, observable, tolerance=t, outside=off_occupied) for t in TOLERANCES
        ),
        free=tuple(free_overlap(drawn, truth, observable, tolerance=t, outside=off_free) for t in TOLERANCES),
        to_truth=distances[0] if distances else None,
        from_truth=distances[1] if distances else None,
        profile=wall_profile(grid, truth, T_truth_grid, observable),
        exact_walls=exact_wall_error(grid, truth, T_truth_grid, observable, walls) if walls is not None else None,
        probability=probability_score(drawn, truth, observable),
        coverage=coverage(drawn, observable),
    )


def _cells_outside(grid: OccupancyGrid, mask: NDArray[np.bool_], truth: OccupancyGrid, T_truth_grid: ArrayLike) -> int:
    """Count the map's cells of `mask` that lie outside of the true map."""
    everywhere = OccupancyGrid(
        probability=np.zeros_like(truth.probability), resolution=truth.resolution, origin=truth.origin
    )
    points = transform_points(T_truth_grid, cell_centres(grid, mask))
    return int(np.isnan(lookup(everywhere, points)).sum())
