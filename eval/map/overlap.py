# SPDX-License-Identifier: MIT
"""How well the cells of a map agree with the truth: IoU and F1 of occupied and of free cells, and coverage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from slam.occupancy import OccupancyGrid


@dataclass(frozen=True)
class Overlap:
    """Agreement of two sets of cells; each number lies between 0 (worst) and 1."""

    precision: float | None
    """Share of the map's cells that are right; None where the map has none."""
    recall: float | None
    """Share of the true cells that the map has; None where the truth has none."""

    @property
    def f1(self) -> float | None:
        """2 P R / (P + R), 0 where either set is empty; None where both are."""
        if self.precision is None and self.recall is None:
            return None
        p, r = self.precision or 0.0, self.recall or 0.0
        return 2.0 * p * r / (p + r) if p + r > 0.0 else 0.0

    @property
    def iou(self) -> float | None:
        """Intersection over union, F1 / (2 - F1); with a tolerance the same formula of the tolerant F1."""
        return None if self.f1 is None else self.f1 / (2.0 - self.f1)


def occupied_overlap(
    grid: OccupancyGrid, truth: OccupancyGrid, observable: NDArray[np.bool_], *, tolerance: int = 0, outside: int = 0
) -> Overlap:
    """Measure the agreement of occupied cells; both maps are on the same cells (`eval.map.grids.resample`).

    Precision P = right / claimed cells, recall R = found / true cells, F1 = 2 P R / (P + R), IoU = F1 / (2 - F1). No
    unit, 0 to 1, more is better. A cell is right within `tolerance` cells in x and y (as Martin, Fowlkes and Malik,
    PAMI 26(5), 2004, score contours). True walls that are not `observable` (rows, cols) count neither as
    missing nor as false; `outside` counts the map's occupied cells outside of the true map, which are all false.
    Trap: at tolerance 0 a shift of half a cell halves the value: read it with 1 and 2, and with the wall distance.
    """
    return _overlap(grid.occupied, truth.occupied, observable, tolerance, outside)


def free_overlap(
    grid: OccupancyGrid, truth: OccupancyGrid, observable: NDArray[np.bool_], *, tolerance: int = 0, outside: int = 0
) -> Overlap:
    """Measure free cells as `occupied_overlap` does. Trap: large rooms make it high whatever the walls look like."""
    return _overlap(grid.free, truth.free, observable, tolerance, outside)


def coverage(grid: OccupancyGrid, observable: NDArray[np.bool_]) -> float | None:
    """Return known / all observable cells, no unit, 0 to 1; None where nothing is observable.

    Trap: it measures exploration and lost scans, not accuracy: a map that is wrong everywhere can cover everything.
    Read it with every score of known cells.
    """
    return float(grid.known[observable].mean()) if observable.any() else None


def _overlap(
    found: NDArray[np.bool_], true: NDArray[np.bool_], observable: NDArray[np.bool_], tolerance: int, outside: int
) -> Overlap:
    near_true, near_found = _grown(true, tolerance), _grown(found, tolerance)
    expected = true & observable
    judged = found & ~(true & ~observable)
    claimed, wanted = int(judged.sum()) + outside, int(expected.sum())
    return Overlap(
        precision=float((judged & near_true).sum()) / claimed if claimed else None,
        recall=float((expected & near_found).sum()) / wanted if wanted else None,
    )


def _grown(mask: NDArray[np.bool_], cells: int) -> NDArray[np.bool_]:
    """Return the cells within `cells` rows and columns of the mask."""
    if cells == 0:
        return mask
    side = 2 * cells + 1
    grown: NDArray[np.bool_] = ndimage.maximum_filter(mask, size=side, mode="constant", cval=0)
    return grown
