# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled part of `map_tiles`: what tiles of a map look like now, and how many of their cells have changed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import kernel
from slam.grid._tile_kernels import SIDE
from testbed.views.map_cells import FREE_FROM, OCCUPIED_TO, UNKNOWN

SAMPLE = 3
"""Of so many tiles, in each direction, one is looked at for differences between maps."""

NOTHING = 256
"""Lighter than all grey levels."""


class Looks(NamedTuple):
    """What squares of a map looked like, in a window that holds the whole map."""

    number: NDArray[np.int32]
    """Number of each tile in the filter's pool, (rows, columns) of tiles."""
    images: NDArray[np.uint8]
    """Grey levels when the tiles were last looked at, (rows, columns, SQUARE, SQUARE) of squares; row 0 of an image at
    the highest y."""
    changed: NDArray[np.int64]
    """Pixels that have changed since the square was last sent, and those that have become of another kind, (rows,
    columns, 2) of squares; a pixel that changes back counts twice."""
    seen: NDArray[np.int64]
    """Pixels that have been seen, (rows, columns) of squares."""


@kernel
def pixel_of(tile, grey, first, coarse):
    """Grey level of a square of `coarse` x `coarse` cells of a tile, whose lowest left cell has the number `first`.

    Of several cells the darkest that was seen counts, so that thin walls stay.
    """
    darkest = NOTHING
    for row in range(coarse):
        for column in range(coarse):
            level = np.int64(grey[tile[first + row * SIDE + column]])
            darkest = min(darkest, level if level != UNKNOWN else NOTHING)
    return UNKNOWN if darkest == NOTHING else darkest


@kernel
def look(table, tiles, grey, touched, since, offset, coarse, looks):
    """Look again at the tiles that may have changed: those with another number, and those touched after a scan.

    table (rows, columns) tile numbers;  tiles (tiles, cells) counts words;  grey (65536,) level of each word
    touched (rows, columns) number of the scan that has last changed each tile;  since: the number of a scan
    offset (2,) row and column of the table's corner in `looks`;  coarse: cells along the side of a pixel
    """
    rows, columns = table.shape
    side = SIDE // coarse
    pixels = looks.images.shape[2]
    small = pixels // side
    now = np.empty(side * side, np.uint8)
    for r in range(rows):
        for c in range(columns):
            at_row, at_column = r + offset[0], c + offset[1]
            if touched[r, c] <= since and table[r, c] == looks.number[at_row, at_column]:
                continue
            looks.number[at_row, at_column] = table[r, c]
            tile = tiles[table[r, c]]
            if coarse > 1:  # all at once, which takes half as long as row by row
                for row in range(side):
                    for column in range(side):
                        now[row * side + column] = pixel_of(tile, grey, (row * SIDE + column) * coarse, coarse)
            image = looks.images[at_row // small, at_column // small]
            bottom, left = pixels - 1 - at_row % small * side, at_column % small * side
            differ, of_other_kind, seen = 0, 0, 0
            for row in range(side):
                line, fresh = image[bottom - row, left : left + side], now[row * side : (row + 1) * side]
                if coarse == 1:
                    for column in range(side):
                        fresh[column] = grey[tile[row * SIDE + column]]
                other = 0
                for column in range(side):
                    other |= fresh[column] ^ line[column]
                if other == 0:  # most rows look as before
                    continue
                for column in range(side):
                    level, before = fresh[column], line[column]
                    line[column] = level
                    differ += level != before
                    seen += np.int64(level != UNKNOWN) - np.int64(before != UNKNOWN)
                    of_other_kind += ((level >= FREE_FROM) != (before >= FREE_FROM)) | (
                        (level <= OCCUPIED_TO) != (before <= OCCUPIED_TO)
                    )
            looks.seen[at_row // small, at_column // small] += seen
            looks.changed[at_row // small, at_column // small, 0] += differ
            looks.changed[at_row // small, at_column // small, 1] += of_other_kind


@kernel
def take_due(looks, everything, stale, share):
    """The squares to be sent again, (squares, 2) of row and column, whose changes count as sent from now on.

    everything: whether any change counts; else more pixels of another kind than `stale` and than `share` of those seen
    """
    rows, columns = looks.seen.shape
    due = np.empty((rows * columns, 2), np.int64)
    count = 0
    for row in range(rows):
        for column in range(columns):
            changed = looks.changed[row, column]
            take = changed[0] > 0 if everything else changed[1] > max(float(stale), share * looks.seen[row, column])
            if take:
                changed[0], changed[1] = 0, 0
                due[count, 0], due[count, 1] = row, column
                count += 1
    return due[:count]


@kernel
def count_differences(table, walls, reference, differences):
    """Count the cells that are a wall in the map of a particle and not in that of another, or the reverse, in
    every `SAMPLE`-th tile of every `SAMPLE`-th row: walls are longer than a tile.

    table (particles, rows, columns) tile numbers;  walls (tiles, SIDE) bit x of word y of a tile
    reference: the other particle;  differences (particles,) is filled
    """
    particles, rows, columns = table.shape
    for p in range(particles):
        count = 0
        for r in range(0, rows, SAMPLE):
            for c in range(0, columns, SAMPLE):
                a, b = table[reference, r, c], table[p, r, c]
                if a == b:
                    continue
                for y in range(walls.shape[1]):
                    bits = np.int64(walls[a, y]) ^ np.int64(walls[b, y])
                    while bits:
                        bits &= bits - 1
                        count += 1
        differences[p] = count
