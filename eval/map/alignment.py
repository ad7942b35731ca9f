# SPDX-License-Identifier: MIT
"""Find the rigid motion that fits a map's walls best to the true ones: it separates a misplaced map from a bent one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft, ndimage, optimize

from eval.map.grids import cell_centres
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose, compose, inverse, transform_points, wrap_angle

MAX_POINTS = 3000
"""Wall cells used by the local search; more are thinned out evenly."""
REACHES = (1.0, 0.2)
"""Distances are clipped at these values [m], first the coarse one, then the fine one, so that outliers have no pull."""
EQUAL_COST_RATIO = 1.1
"""Motions whose cost is up to this many times the smallest one count as equally good, and the one that moves the map
least is taken: in a world that looks the same after a half turn the map stays where the trajectory puts it."""
_SCALE = np.array([0.1, 0.1, 0.01])
"""Steps of the local search that move walls by similar amounts [m, m, rad]."""
_COARSE_SIDE = 200
"""Approximate number of cells per side of the raster of the global search."""
_MAX_CANDIDATES = 6
"""Motions of the global search that are refined by the local one."""


def best_rigid_alignment(grid: OccupancyGrid, truth: OccupancyGrid, T_truth_grid: ArrayLike) -> Pose:
    """Return the `T_truth_grid` (3,) that fits the map's occupied cells best to the true ones, from any turn or shift.

    It minimises the mean distance to the nearest true wall, clipped at 0.2 m, by the simplex method (Nelder and Mead,
    1965), starting from the given motion and from the best results of a search over all turns and shifts
    (`_coarse_places`). The given motion is returned where either map has no occupied cell or nothing better is found.
    Trap: it flatters a map, so report it together with the score under the trajectory's alignment.
    """
    start = np.asarray(T_truth_grid, dtype=np.float64)
    points = cell_centres(grid, grid.occupied)
    if len(points) == 0 or not truth.occupied.any():
        return start
    walls = _WallFit.of(truth, points[:: -(-len(points) // MAX_POINTS)])
    places = [walls.refined(place) for place in (start, *_coarse_places(truth, points))]
    costs = [walls.cost(place) for place in places]
    equal = EQUAL_COST_RATIO * min(costs) + 0.01 * truth.resolution
    return min(
        (place for place, cost in zip(places, costs, strict=True) if cost <= equal),
        key=lambda place: walls.displacement(start, place),
    )


@dataclass(frozen=True, eq=False)
class _WallFit:
    """Cost of a rigid motion, and the local search that lowers it."""

    field: NDArray[np.float64]
    """Distance of each true cell from the nearest true wall [m], (rows, cols)."""
    truth: OccupancyGrid
    points: NDArray[np.float64]
    """Centres of the map's walls in the map's frame [m], (k, 2)."""

    @classmethod
    def of(cls, truth: OccupancyGrid, points: NDArray[np.float64]) -> _WallFit:
        field = truth.resolution * ndimage.distance_transform_edt(~truth.occupied)
        return cls(np.asarray(field, dtype=np.float64), truth, points)

    def cost(self, T_truth_grid: Pose, reach: float = REACHES[-1]) -> float:
        """Return the mean distance to the nearest true wall [m], each distance clipped at `reach` [m]."""
        at = transform_points(compose(inverse(self.truth.origin), T_truth_grid), self.points)
        col, row = (at / self.truth.resolution - 0.5).T
        distance = ndimage.map_coordinates(self.field, [row, col], order=1, cval=reach)
        return float(np.mean(np.minimum(distance, reach)))

    def displacement(self, T_a: Pose, T_b: Pose) -> float:
        """Return how far the walls move from one motion to another, root mean square [m]."""
        moved = transform_points(T_b, self.points) - transform_points(T_a, self.points)
        return float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))

    def refined(self, start: Pose) -> Pose:
        """Return the local optimum near `start`; rotations are about the centre of the walls."""
        centre = np.array([*self.points.mean(axis=0), 0.0])
        to_centre, back = compose(start, centre), inverse(centre)

        def place(scaled: NDArray[np.float64]) -> Pose:
            return compose(compose(to_centre, scaled * _SCALE), back)

        def cost(scaled: NDArray[np.float64], reach: float) -> float:
            return self.cost(place(scaled), reach)

        change = np.zeros(3)
        for reach, size in zip(REACHES, (5.0, 0.5), strict=True):
            simplex = change + size * np.concatenate([np.zeros((1, 3)), np.eye(3)])
            fit = optimize.minimize(
                cost,
                change,
                (reach,),
                method="Nelder-Mead",
                options={"initial_simplex": simplex, "xatol": 1e-3},
            )
            if cost(fit.x, REACHES[-1]) < cost(change, REACHES[-1]):
                change = fit.x
        return place(change) if change.any() else start


def _coarse_places(truth: OccupancyGrid, points: NDArray[np.float64]) -> list[Pose]:
    """Return the best `T_truth_grid` of all turns and shifts, best first, no two of nearly one turn.

    For each turn the map's walls, points (k, 2) [m] in the map's frame, are correlated with a raster of the true walls,
    whose values fall off over three cells, for all shifts at once by FFT (Olson, ICRA 2009, searches a window).
    Neighbouring turns move the walls by about two cells at their typical distance from the centre.
    """
    centre = points.mean(axis=0)
    local = points - centre
    radius = float(np.sqrt(np.mean(np.sum(local**2, axis=1))))
    half = float(np.hypot(*local.T).max())
    rows, cols = truth.probability.shape
    widest = max(rows, cols) * truth.resolution
    cell = max(2.0 * truth.resolution, (widest + 2.0 * half) / _COARSE_SIDE)

    true = transform_points(inverse(truth.origin), cell_centres(truth, truth.occupied))
    margin = int(np.ceil(half / cell)) + 3
    side = fft.next_fast_len(int(np.ceil(widest / cell)) + 2 * margin, real=True)
    near = np.maximum(0.0, 1.0 - ndimage.distance_transform_edt(_raster(true, cell, margin, side) == 0.0) / 3.0)
    spectrum = fft.rfft2(near)

    turns = np.linspace(0.0, 2.0 * np.pi, max(36, int(np.pi * radius / cell)), endpoint=False)
    found = []
    for turn in turns:
        walls = _raster(transform_points([0.0, 0.0, turn], local), cell, margin, side)
        score = fft.irfft2(spectrum * np.conj(fft.rfft2(walls)), s=(side, side))
        row, col = np.unravel_index(int(np.argmax(score)), score.shape)
        # The raster is periodic: shifts beyond its far edge are shifts backwards.
        x, y = (cell * (k - side if k >= side - margin else k) for k in (int(col), int(row)))
        found.append((float(score[row, col]), np.array([x, y, turn])))

    chosen: list[Pose] = []
    apart = 2.5 * 2.0 * np.pi / len(turns)
    for _, place in sorted(found, key=lambda item: -item[0]):
        if all(abs(wrap_angle(place[2] - other[2])) > apart for other in chosen):
            chosen.append(place)
    return [compose(compose(truth.origin, place), [*-centre, 0.0]) for place in chosen[:_MAX_CANDIDATES]]


def _raster(points: NDArray[np.float64], cell: float, margin: int, side: int) -> NDArray[np.float64]:
    """Count the points (k, 2) [m] in each cell of a square raster, (side, side), with `margin` cells below zero."""
    col, row = (np.floor(points / cell).astype(np.intp) + margin).T
    counts = np.bincount(row * side + col, minlength=side * side).reshape(side, side)
    return counts.astype(np.float64)
