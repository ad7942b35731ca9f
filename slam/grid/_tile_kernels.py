# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the tile pools: which tiles a change needs, private copies of them, and where a cell lies.

Cells are numbered from the corner of the tile tables: `cx` counts to the right, `cy` upwards, both from 0. A table
holds the number of each particle's tile at `[particle, cy >> SHIFT, cx >> SHIFT]`; number 0 is the empty tile that
everybody shares and nobody writes. Fine tiles, of half the side, are for what lies along walls, of which large tiles
would be mostly empty.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._array_kernels import copy_values
from slam._jit import inlined, kernel

SHIFT = 4
SIDE = 1 << SHIFT
MASK = SIDE - 1
FINE_SHIFT = 3
FINE_SIDE = 1 << FINE_SHIFT
FINE_MASK = FINE_SIDE - 1


class TileRequest(NamedTuple):
    """The tiles that each particle is about to write."""

    tiles: NDArray[np.int32]
    """Flat indices into the table, (particles, table rows * columns + 1); the first `count` of each row are valid."""
    count: NDArray[np.int64]
    """Number of indices, (particles,)."""
    seen: NDArray[np.uint8]
    """1 where the index is in the list, (particles, table rows * columns)."""


@inlined
def tile_at(table, cx, cy):
    """Number of the tile that holds a cell, from one particle's table (rows, columns).

    Unsigned, as all indices in inner loops: for signed ones numba compiles a test for negative values, which made
    matching slower by a sixth (benchmark: tests/benchmarks).
    """
    return np.uint64(table[np.uint64(cy >> SHIFT), np.uint64(cx >> SHIFT)])


@inlined
def in_tile(cx, cy):
    """Index of a cell in its tile."""
    return np.uint64(((cy & MASK) << SHIFT) | (cx & MASK))


@inlined
def fine_tile_at(table, cx, cy):
    """Return what `tile_at` returns, from a table of fine tiles."""
    return np.uint64(table[np.uint64(cy >> FINE_SHIFT), np.uint64(cx >> FINE_SHIFT)])


@inlined
def in_fine_tile(cx, cy):
    """Index of a cell in its fine tile."""
    return np.uint64(((cy & FINE_MASK) << FINE_SHIFT) | (cx & FINE_MASK))


@inlined
def request_tile(index, tiles, count, seen):
    """Add a flat table index to one particle's list, unless it is in it already; returns the new count.

    Without a branch: numba drops the counting of references to arrays that are passed to an inlined function only
    where that has a single path, and with it this would be eight times slower.
    """
    tiles[np.uint64(count)] = index
    new = 1 - np.int64(seen[np.uint64(index)])
    seen[np.uint64(index)] = 1
    return count + new


@kernel
def copies_needed(table, references, request):
    """How many tiles `copy_on_write` takes from the free ones, at most."""
    flat = table.reshape(table.shape[0], -1)
    needed = 0
    for particle in range(table.shape[0]):
        for k in range(request.count[particle]):
            old = flat[particle, request.tiles[particle, k]]
            if old == 0 or references[old] > 1:
                needed += 1
    return needed


@kernel
def copy_on_write(table, references, free, free_count, request, copies):
    """Give every particle tiles of its own where it wants to write, and empty its list; the caller copies the contents.

    table (particles, rows, columns) tile numbers;  references (tiles,) owners of each tile
    free (tiles,) stack of unused tile numbers, its first `free_count` are valid; must hold enough
    copies (n, 2) out: tile to copy from, tile to copy to, in particle order
    Returns the number of copies and the new free_count. Serial, so that tile numbers do not depend on the number of
    threads.
    """
    particles = table.shape[0]
    flat = table.reshape(particles, -1)
    total = 0
    for particle in range(particles):
        for k in range(request.count[particle]):
            index = request.tiles[particle, k]
            request.seen[particle, index] = 0
            old = flat[particle, index]
            if old != 0 and references[old] == 1:
                continue
            free_count -= 1
            new = free[free_count]
            flat[particle, index] = new
            references[new] = 1
            if old != 0:
                references[old] -= 1
            copies[total, 0] = old
            copies[total, 1] = new
            total += 1
        request.count[particle] = 0
    return total, free_count


@kernel
def count_owners(table, references, free):
    """Count the owners of each tile again, after tables were copied or dropped.

    table (particles, rows, columns) tile numbers;  references (tiles,) out;  free (tiles,) out: stack of the tiles that
    nobody owns, the lowest number on top. Returns how many these are.
    """
    references[:] = 0
    for tile in table.ravel():
        references[tile] += 1
    references[0] = 1  # the empty tile
    count = 0
    for tile in range(references.shape[0] - 1, 0, -1):
        if references[tile] == 0:
            free[count] = tile
            count += 1
    return count


@kernel
def copy_tiles(start, stop, data, copies):
    """Copy whole tiles: rows [start, stop) of copies (n, 2) as (from, to); data (tiles, cells)."""
    for k in range(start, stop):
        copy_values(data[copies[k, 0]], data[copies[k, 1]])
