# SPDX-License-Identifier: MIT
"""The field of nearest walls: which wall each cell near a wall is nearest to, as a word for the offset to it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam.grid._cell_kernels import NO_STEP, NO_WALL
from slam.grid._tile_kernels import SIDE

MAX_RADIUS = 63
"""The largest radius of a field [cells]; up to 9 cells a word fits a byte."""


class OffsetTable(NamedTuple):
    """The cells within the field's radius of a cell, and the word for each."""

    radius: int
    """Radius of the field [cells]."""
    half_width: NDArray[np.int64]
    """How far each row reaches to both sides [cells], (2 radius + 1,)."""
    word: NDArray[np.int64]
    """Word of the wall at an offset, [dy + radius, dx + radius]; 0 beyond the radius."""
    about: NDArray[np.uint8] | NDArray[np.uint16]
    """Words that point to one wall from the cells of a column of tiles about it, (2 radius + SIDE, 2 radius + 1, SIDE):
    [x - cx + radius + SIDE - 1, y - cy + radius] is the row of the tile whose left cell is (x, y), for the wall
    (cx, cy); 0 beyond the radius."""
    offset: NDArray[np.int64]
    """Offset dx, dy of each word, (words + 1, 2)."""
    step: NDArray[np.int32]
    """The same as a step, see `_cell_kernels`; `NO_STEP` for no wall, (words + 1,)."""


def smallest_type(words: int) -> type[np.uint8] | type[np.uint16]:
    """The smallest type for so many field words."""
    return np.uint8 if words <= 256 else np.uint16


def make_offset_table(radius: int) -> OffsetTable:
    """The offsets within a radius [cells]: the nearer, the larger the word; see `_distance_field_kernels`."""
    rows = np.arange(-radius, radius + 1)
    dx, dy = np.meshgrid(rows, rows)
    distance2 = dx**2 + dy**2
    inside = distance2 <= radius**2
    order = np.lexsort((dx[inside], dy[inside], distance2[inside]))[::-1]
    offset = np.concatenate([np.zeros((1, 2), np.int64), np.stack([dx[inside], dy[inside]], axis=-1)[order]])
    word = np.zeros(dx.shape, np.int64)
    word[offset[1:, 1] + radius, offset[1:, 0] + radius] = np.arange(1, len(offset))
    row = np.pad(word[::-1, ::-1], ((0, 0), (SIDE - 1, SIDE - 1)))
    columns = np.stack([row[:, left : left + SIDE] for left in range(2 * radius + SIDE)])
    about: NDArray[Any] = columns.astype(smallest_type(len(offset)))
    step = ((offset[:, 1] << 16) + offset[:, 0]).astype(np.int32)
    step[NO_WALL] = NO_STEP
    half_width = np.sqrt(radius**2 - rows**2).astype(np.int64)
    return OffsetTable(radius, half_width, word, about, offset, step)
