# SPDX-License-Identifier: MIT
"""The floor as a robot that plans sees it: coarse cells of the estimated map, where it fits, and ways between them.

Plans are made while the robot drives, on maps with unknown cells, and so by a compiled search; tours of known worlds
are planned once, by `worlds.plan_tour`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry import LineString

from slam.occupancy import OccupancyGrid
from slam.se2 import inverse, transform_points
from testbed.exploration.planning._grid_kernels import cheapest_ways

CELL = 0.1
"""Side of a planning cell, rounded to whole cells of the map [m]."""
MARGIN = 0.06
"""The footprint keeps this distance from walls: half a planning cell's diagonal, rounded down [m]."""
_ROOMY = 0.5
"""Ways keep this distance from walls where they can [m]."""
_DEAREST = 4.0
"""What a step beside a wall costs, compared with one in the open."""
_START_REACH = 0.5
"""A robot that stands where it does not fit, as far as the map knows, plans from the nearest cell within this [m]."""

_EVEN = 0.5
"""P(occupied) below which a part of a cell counts as free: one beam has passed it, more than speaks against it."""

Cell = tuple[int, int]


class Floor:
    """Planning cells of one map, all arrays (rows, cols), row 0 = lowest y."""

    def __init__(self, grid: OccupancyGrid, footprint_radius: float) -> None:
        """footprint_radius: of the robot [m]."""
        share = max(1, round(CELL / grid.resolution))
        self.cell = share * grid.resolution
        """Side of a planning cell [m]."""
        self._origin = grid.origin
        border = 2  # cells, so that every known cell has neighbours
        rows, cols = (-(-n // share) + 2 * border for n in grid.probability.shape)
        fine = np.full((rows * share, cols * share), np.nan, dtype=np.float32)
        begin = border * share
        fine[begin : begin + grid.probability.shape[0], begin : begin + grid.probability.shape[1]] = grid.probability
        self._border = border * self.cell
        blocks = fine.reshape(rows, share, cols, share)
        known = ~np.isnan(blocks)
        seen: NDArray[np.bool_] = np.any(known, axis=(1, 3))
        walls: NDArray[np.bool_] = np.any(blocks > OccupancyGrid.OCCUPIED, axis=(1, 3))
        clear: NDArray[np.bool_] = np.any(blocks < _EVEN, axis=(1, 3))
        self.occupied = walls
        """Cells with a wall in them."""
        self.free = clear & ~walls
        """Cells seen free at least in part."""
        self.unknown = ~seen
        """Cells never seen."""
        self.probability: NDArray[np.float32] = np.where(known, blocks, np.float32(0.5)).mean(axis=(1, 3))
        """P(occupied), 0.5 where unknown."""
        room = ndimage.distance_transform_edt(~self.occupied) * self.cell
        open_cells = self.free & (room > footprint_radius + MARGIN)
        near = np.interp(room - footprint_radius, [MARGIN, _ROOMY], [_DEAREST, 1.0])
        self._dearness = np.where(open_cells, near, np.inf)

    @property
    def open(self) -> NDArray[np.bool_]:
        """Cells that the robot's centre can be in, as far as is known."""
        cells: NDArray[np.bool_] = np.isfinite(self._dearness)
        return cells

    def cell_of(self, x: float, y: float) -> Cell:
        """The cell of a point [m, map frame], perhaps off the grid."""
        at = transform_points(inverse(self._origin), np.array([[x, y]]))[0] + self._border
        return math.floor(at[1] / self.cell), math.floor(at[0] / self.cell)

    def middles(self, cells: NDArray[np.intp]) -> NDArray[np.float64]:
        """Middles of cells `(row, col)`, (n, 2), as points (x, y) [m, map frame]."""
        return transform_points(self._origin, (cells[:, ::-1] + 0.5) * self.cell - self._border)

    def middle(self, cell: Cell) -> NDArray[np.float64]:
        """Middle of one cell (2,) [m, map frame]."""
        point: NDArray[np.float64] = self.middles(np.array([cell]))[0]
        return point

    def inside(self, cell: Cell) -> bool:
        """Whether a cell lies on the grid."""
        rows, cols = self.free.shape
        return cell[0] in range(rows) and cell[1] in range(cols)

    def nearest_open(self, x: float, y: float) -> Cell | None:
        """The open cell nearest to a point [m, map frame]; None if none is near."""
        row, col = self.cell_of(x, y)
        if not self.inside((row, col)):
            return None
        reach = math.ceil(_START_REACH / self.cell)
        low_row, low_col = max(row - reach, 0), max(col - reach, 0)
        cells = np.argwhere(self.open[low_row : row + reach + 1, low_col : col + reach + 1])
        if len(cells) == 0:
            return None
        cells += [low_row, low_col]
        best = cells[np.argmin(((cells - [row, col]) ** 2).sum(axis=1))]
        return int(best[0]), int(best[1])

    def ways_from(self, start: Cell) -> Ways:
        """The cheapest ways from an open cell to all others."""
        return Ways(self, start)


class Ways:
    """Cheapest ways over the floor from one cell: short, and with room where there is some."""

    def __init__(self, floor: Floor, start: Cell) -> None:
        self._floor = floor
        costs, self._before = cheapest_ways(floor._dearness, *start)
        self.costs: NDArray[np.float64] = costs * floor.cell
        """Of the way to each cell: its length [m], more beside walls; inf where no way leads, (rows, cols)."""

    def path(self, goal: Cell) -> NDArray[np.float64]:
        """Corners of the way to a cell that can be reached, (n, 2) [m, map frame], n >= 1."""
        cols = self._before.shape[1]
        cells = [goal]
        while (before := int(self._before[cells[-1]])) >= 0:
            cells.append((before // cols, before % cols))
        points = self._floor.middles(np.array(cells[::-1]))
        if len(points) < 3:
            return points
        corners: NDArray[np.float64] = np.array(LineString(points).simplify(0.5 * self._floor.cell).coords)
        return corners
