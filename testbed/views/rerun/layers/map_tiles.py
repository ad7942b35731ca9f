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
from testbed.views.rerun.layers._tile_kernels import Looks, look, take_due

SQUARE = 128
"""Pixels along the side of a square."""
MAX_STALE, MAX_STALE_SHARE = 32, 0.01
"""Pixels of a square that may be of another kind (free, occupied, never seen) than what was sent last: so many, or this
share of those that were seen, whichever is more. How free or how occupied they are is sent along with others, or when
`everything` is asked for."""

Index = tuple[int, int]
"""Column and row of a square, counted from the map's origin."""


class Square(NamedTuple):
    """A square of the map that has changed."""

    grid_index: Index
    image: NDArray[np.uint8]
    """Grey levels, (SQUARE, SQUARE), row 0 at the highest y, as in a picture."""


class ImagePool:
    """Memory for the images of squares that wait to be sent, used again and again: new memory costs more than what is
    written into it."""

    def __init__(self, images: int) -> None:
        """Memory for so many images."""
        self._images = np.empty((images, SQUARE, SQUARE), np.uint8)
        self._used = 0

    @property
    def full(self) -> bool:
        """Whether further images take new memory."""
        return self._used >= len(self._images)

    def copy_of(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """A copy of an image (SQUARE, SQUARE), valid until `clear`."""
        if self.full:
            return image.copy()
        copy: NDArray[np.uint8] = self._images[self._used]
        copy[:] = image
        self._used += 1
        return copy

    def clear(self) -> None:
        """Take back the memory of all images."""
        self._used = 0


class MapTiles:
    """What was last sent of one map."""

    def __init__(self, pool: ImagePool, coarse: int = 1) -> None:
        """Nothing was sent yet.

        pool: where the images are;  coarse: cells along the side of a pixel, a power of 2
        """
        self.coarse = coarse
        self._pool = pool
        self._small = SQUARE * coarse // SIDE  # tiles of the filter along the side of a square
        self._corner = (0, 0)  # column and row of the square in the corner, counted from the map's origin
        self._window: tuple[object, object] | None = None  # corner and shape of the map that was seen last
        self._offset = np.zeros(2, np.int64)  # row and column of its corner in what is remembered, in tiles
        self._scans = 0  # number of the last scan in what was seen
        self._looks = self._nothing_seen(0, 0)

    def changes(self, cells: MapCells, everything: bool = False) -> list[Square]:
        """The squares that look different now, row by row; with `everything` also those that differ only a little."""
        window = cells.corner, cells.table.shape
        if window != self._window:
            self._window = window
            self._find_room(cells)
        look(cells.table, cells.tiles, cells.grey, cells.touched, self._scans, self._offset, self.coarse, self._looks)
        self._scans = cells.scans
        left, below, images = *self._corner, self._looks.images
        stale = (0, 0.0) if everything else (MAX_STALE, MAX_STALE_SHARE)
        return [
            Square((left + column, below + row), self._pool.copy_of(images[row, column]))
            for row, column in take_due(self._looks, everything, *stale).tolist()
        ]

    def _find_room(self, cells: MapCells) -> None:
        """Make room for the tiles of a map, and note where they lie in what is remembered."""
        column, row = cells.corner[0] // SIDE, cells.corner[1] // SIDE
        rows, columns = cells.table.shape
        self._make_room((column, row), (column + columns, row + rows))
        self._offset = np.array([row - self._corner[1] * self._small, column - self._corner[0] * self._small])

    def _make_room(self, first: tuple[int, int], end: tuple[int, int]) -> None:
        """Extend what is remembered to the squares of the tiles from `first` to before `end`, each (column, row)."""
        rows, columns = self._looks.changed.shape[:2]
        low = [number // self._small for number in first]
        high = [-(-number // self._small) for number in end]
        if rows == 0:
            self._corner = low[0], low[1]
        left, below = (max(have - need, 0) for have, need in zip(self._corner, low, strict=True))
        right = max(high[0] - self._corner[0] - columns, 0)
        above = max(high[1] - self._corner[1] - rows, 0)
        if not (left or below or right or above):
            return
        old, self._looks = self._looks, self._nothing_seen(rows + below + above, columns + left + right)
        for former, values in zip(old, self._looks, strict=True):
            scale = self._small if former is old.number else 1
            place = np.s_[below * scale : (below + rows) * scale, left * scale : (left + columns) * scale]
            cast(NDArray[Any], values)[place] = former
        self._corner = self._corner[0] - left, self._corner[1] - below

    def _nothing_seen(self, rows: int, columns: int) -> Looks:
        """Squares (rows, columns) that were never seen."""
        return Looks(
            number=np.zeros((rows * self._small, columns * self._small), np.int32),
            images=np.full((rows, columns, SQUARE, SQUARE), UNKNOWN, np.uint8),
            changed=np.zeros((rows, columns, 2), np.int64),
            seen=np.zeros((rows, columns), np.int64),
        )
