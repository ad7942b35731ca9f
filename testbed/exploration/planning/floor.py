# SPDX-License-Identifier: MIT
"""The floor on which a robot plans: coarse cells of the estimated map that the robot fits in, and paths over them.

The search is compiled, because it runs while the robot drives; `worlds.plan_tour` plans the tours of known worlds.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry import LineString

from slam.occupancy import OccupancyGrid
from slam.se2 import inverse, transform_points
from testbed.exploration.planning._grid_kernels import shortest_paths

CELL = 0.1
"""Side of a planning cell, rounded to whole cells of the map [m]."""
MARGIN = 0.06
"""Least distance of the footprint from walls: half a planning cell's diagonal, rounded down [m]."""
_PREFERRED_CLEARANCE = 0.5
"""Paths keep this distance from walls where there is room [m]."""
_MAX_COST = 4.0
"""Cost of a step next to a wall, as a multiple of one in the open."""
_START_REACH = 0.5
"""Where the map says that the robot does not fit, it plans from the nearest open cell up to this far away [m]."""

_EVEN = 0.5
"""P(occupied) below which a map cell counts as free: more beams passed it than ended in it."""

Cell = tuple[int, int]


class Floor:
    """Planning cells of one map; all arrays are (rows, cols), row 0 = lowest y."""

    def __init__(self, grid: OccupancyGrid, footprint_radius: float) -> None:
        """footprint_radius: that of the robot [m]."""
        share = max(1, round(CELL / grid.resolution))
        self.cell = share * grid.resolution
        """Side of a planning cell [m]."""
        self._origin = grid.origin
        border = 2  # cells: every known cell gets neighbours
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
        """Cells that hold a wall."""
        self.free = clear & ~walls
        """Cells that hold a free map cell and no wall."""
        self.unknown = ~seen
        """Cells that hold no known map cell."""
        self.probability: NDArray[np.float32] = np.where(known, blocks, np.float32(0.5)).mean(axis=(1, 3))
        """P(occupied), 0.5 where unknown."""
        room = ndimage.distance_transform_edt(~self.occupied) * self.cell
        open_cells = self.free & (room > footprint_radius + MARGIN)
        near = np.interp(room - footprint_radius, [MARGIN, _PREFERRED_CLEARANCE], [_MAX_COST, 1.0])
        self._cost = np.where(open_cells, near, np.inf)

    @property
    def open(self) -> NDArray[np.bool_]:
        """Cells that the robot's centre can be in, according to the map."""
        cells: NDArray[np.bool_] = np.isfinite(self._cost)
        return cells

    def cell_of(self, x: float, y: float) -> Cell:
        """Return the cell of a point [m, map frame]; it may lie off the grid."""
        at = transform_points(inverse(self._origin), np.array([[x, y]]))[0] + self._border
        return math.floor(at[1] / self.cell), math.floor(at[0] / self.cell)

    def centres(self, cells: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the centres (x, y) of cells `(row, col)`, both (n, 2) [m, map frame]."""
        return transform_points(self._origin, (cells[:, ::-1] + 0.5) * self.cell - self._border)

    def centre(self, cell: Cell) -> NDArray[np.float64]:
        """Return the centre of one cell (2,) [m, map frame]."""
        point: NDArray[np.float64] = self.centres(np.array([cell]))[0]
        return point

    def inside(self, cell: Cell) -> bool:
        """Return whether a cell lies on the grid."""
        rows, cols = self.free.shape
        return cell[0] in range(rows) and cell[1] in range(cols)

    def nearest_open(self, x: float, y: float) -> Cell | None:
        """Return the open cell nearest to a point [m, map frame]; None if none is within `_START_REACH`."""
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

    def shortest_paths_from(self, start: Cell) -> ShortestPaths:
        """Return the cheapest paths from an open cell to all others."""
        return ShortestPaths(self, start)


class ShortestPaths:
    """Cheapest paths over the floor from one cell: short, and away from walls where there is room."""

    def __init__(self, floor: Floor, start: Cell) -> None:
        self._floor = floor
        costs, self._before = shortest_paths(floor._cost, *start)
        self.costs: NDArray[np.float64] = costs * floor.cell
        """Cost of the path to each cell: its length [m], more near walls; inf where no path leads, (rows, cols)."""

    def path(self, goal: Cell) -> NDArray[np.float64]:
        """Return the corners of the path to a cell that can be reached, (n, 2) [m, map frame], n >= 1."""
        cols = self._before.shape[1]
        cells = [goal]
        while (before := int(self._before[cells[-1]])) >= 0:
            cells.append((before // cols, before % cols))
        points = self._floor.centres(np.array(cells[::-1]))
        if len(points) < 3:
            return points
        corners: NDArray[np.float64] = np.array(LineString(points).simplify(0.5 * self._floor.cell).coords)
        return corners
