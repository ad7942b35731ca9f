# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled part of `map_tiles`: what tiles of a map look like now, and how many of their cells have changed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import kernel
from testbed.views.map_cells import FREE_FROM, OCCUPIED_TO


class Looks(NamedTuple):
    """What tiles looked like, in a window of (rows, columns) tiles that holds the whole map."""

    number: NDArray[np.int32]
    """Number of the tile in the filter's pool, (rows, columns)."""
    seen: NDArray[np.uint8]
    """Grey levels when the tile was last looked at, (rows, columns, cells)."""
    sent: NDArray[np.uint8]
    """Grey levels that were last sent, (rows, columns, cells)."""
    changed: NDArray[np.int64]
    """Cells that differ between the two, and those of another kind, (rows, columns, 2)."""


@kernel
def kind_of(grey):
    """0 = never seen, 1 = rather free, 2 = rather occupied."""
    if grey >= FREE_FROM:
        return 1
    return 2 if grey <= OCCUPIED_TO else 0


@kernel
def look(table, tiles, grey, touched, since, offset, looks):
    """Look again at the tiles that may have changed: those with another number, and those touched after a scan.

    table (rows, columns) tile numbers;  tiles (tiles, cells) counts words;  grey (65536,) level of each word
    touched (rows, columns) number of the scan that has last changed each tile;  since: the number of a scan
    offset (2,) row and column of the table's corner in `looks`
    """
    rows, columns = table.shape
    cells = tiles.shape[1]
    for r in range(rows):
        for c in range(columns):
            at_row, at_column = r + offset[0], c + offset[1]
            if touched[r, c] <= since and table[r, c] == looks.number[at_row, at_column]:
                continue
            looks.number[at_row, at_column] = table[r, c]
            tile, seen, sent = tiles[table[r, c]], looks.seen[at_row, at_column], looks.sent[at_row, at_column]
            differ, of_other_kind = 0, 0
            for k in range(cells):
                now = grey[tile[k]]
                seen[k] = now
                if now != sent[k]:
                    differ += 1
                    of_other_kind += kind_of(now) != kind_of(sent[k])
            looks.changed[at_row, at_column, 0] = differ
            looks.changed[at_row, at_column, 1] = of_other_kind
