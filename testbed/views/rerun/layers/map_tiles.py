# SPDX-License-Identifier: MIT
"""The map of a particle in squares of which only those that have changed are sent again.

A whole map for each second of a run would fill the viewer's memory (it keeps maps uncompressed) and cost more time
than the run may spend on being watched. A robot changes the map within its lidar's range only, and a cell that was
seen five times looks the same from then on.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from slam.grid._tile_kernels import SIDE
from testbed.views.map_cells import UNKNOWN, MapCells
from testbed.views.rerun.layers._tile_kernels import Looks, look

SMALL = 8
"""Tiles of the filter along the side of a square."""
SQUARE = SMALL * SIDE
"""Cells along the side of a square."""
MAX_STALE = 8
"""Cells of a square (of 16384) that may be of another kind (free, occupied, never seen) than what was sent last; how
free or how occupied they are is sent along with others, or when `everything` is asked for."""

Index = tuple[int, int]
"""Column and row of a square, counted from the map's origin."""


class Square(NamedTuple):
    """A square of the map that has changed."""

    grid_index: Index
    image: NDArray[np.uint8]
    """Grey levels, (SQUARE, SQUARE), row 0 at the highest y, as in a picture."""


class MapTiles:
    """What was last sent of one map."""

    def __init__(self) -> None:
        """Nothing was sent yet."""
        self._corner = (0, 0)  # column and row of the tile in the corner, counted from the map's origin
        self._scans = 0  # number of the last scan in what was seen
        self._looks = _nothing_seen(0, 0)

    def changes(self, cells: MapCells, everything: bool = False) -> list[Square]:
        """The squares that look different now, row by row; with `everything` also those that differ only a little."""
        column, row = cells.corner[0] // SIDE, cells.corner[1] // SIDE
        rows, columns = cells.table.shape
        self._make_room((column, row), (column + columns, row + rows))
        offset = np.array([row - self._corner[1], column - self._corner[0]])
        look(cells.table, cells.tiles, cells.grey, cells.touched, self._scans, offset, self._looks)
        self._scans = cells.scans
        changed = self._by_square(self._looks.changed).sum(axis=(1, 3))
        due = changed[..., 0] > 0 if everything else changed[..., 1] > MAX_STALE
        return [self._take(row, column) for row, column in zip(*np.nonzero(due), strict=True)]

    def _by_square(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values of tiles (rows, columns, ...) as (rows of squares, SMALL, columns of squares, SMALL, ...)."""
        rows, columns = values.shape[:2]
        return values.reshape(rows // SMALL, SMALL, columns // SMALL, SMALL, *values.shape[2:])

    def _take(self, row: int, column: int) -> Square:
        """A square of what was seen, which counts as sent then."""
        part = np.s_[row * SMALL : (row + 1) * SMALL, column * SMALL : (column + 1) * SMALL]
        tiles = self._looks.seen[part]
        self._looks.sent[part] = tiles
        self._looks.changed[part] = 0
        image = tiles.reshape(SMALL, SMALL, SIDE, SIDE).swapaxes(1, 2).reshape(SQUARE, SQUARE)
        index = self._corner[0] // SMALL + int(column), self._corner[1] // SMALL + int(row)
        return Square(index, np.ascontiguousarray(image[::-1]))

    def _make_room(self, first: tuple[int, int], end: tuple[int, int]) -> None:
        """Extend what is remembered to the squares of the tiles from `first` to before `end`, each (column, row)."""
        rows, columns = self._looks.number.shape
        if rows == 0:
            self._corner = first[0] // SMALL * SMALL, first[1] // SMALL * SMALL
        left, below = (-(-max(have - need, 0) // SMALL) * SMALL for have, need in zip(self._corner, first, strict=True))
        right = -(-max(end[0] - self._corner[0] - columns, 0) // SMALL) * SMALL
        above = -(-max(end[1] - self._corner[1] - rows, 0) // SMALL) * SMALL
        if not (left or below or right or above):
            return
        old, self._looks = self._looks, _nothing_seen(rows + below + above, columns + left + right)
        place = np.s_[below : below + rows, left : left + columns]
        for former, values in zip(old, self._looks, strict=True):
            cast(NDArray[Any], values)[place] = former
        self._corner = self._corner[0] - left, self._corner[1] - below


def _nothing_seen(rows: int, columns: int) -> Looks:
    """Tiles that were never seen."""
    cells = (rows, columns, SIDE * SIDE)
    return Looks(
        number=np.zeros((rows, columns), np.int32),
        seen=np.full(cells, UNKNOWN, np.uint8),
        sent=np.full(cells, UNKNOWN, np.uint8),
        changed=np.zeros((rows, columns, 2), np.int64),
    )
