# SPDX-License-Identifier: MIT
"""Pools of fixed-size tiles, shared between particles by reference count and copied on the first write."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from slam._threads import Threads
from slam.grid._tile_kernels import TileRequest, copies_needed, copy_on_write, copy_tiles, count_owners

FIRST_BYTES = 40_000_000
"""Size of a pool's array at first. Memory that was never touched costs nothing, and blocks above 32 MB are mapped on
their own (mallopt(3), M_MMAP_THRESHOLD): the system can move them when they grow, and smaller ones leave no holes."""
MIN_SHARED_COPIES = 4096
"""A second thread is used only when at least this many tiles are copied."""


class TilePool:
    """Tiles of `SIDE` x `SIDE` cells and, for each particle, a table that says which tile lies where.

    Tile 0 is empty for ever: reading where nobody wrote needs no special case. One pool may hold several arrays, as
    for counts and surfaces, that are always written together.
    """

    def __init__(self, particles: int, layout: Sequence[tuple[DTypeLike, int]]) -> None:
        """An empty table (particles, 0, 0) and one array (tiles, words) per (dtype, words) of the layout."""
        self.table: NDArray[np.int32] = np.zeros((particles, 0, 0), np.int32)
        self.references: NDArray[np.int32] = np.ones(1, np.int32)
        self.data = [
            np.zeros((FIRST_BYTES // (np.dtype(dtype).itemsize * words), words), dtype) for dtype, words in layout
        ]
        self._free: NDArray[np.int32] = np.zeros(1, np.int32)
        self._free_count = 0
        self.request = self._empty_request()

    def _empty_request(self) -> TileRequest:
        particles, rows, columns = self.table.shape
        return TileRequest(
            tiles=np.zeros((particles, rows * columns + 1), np.int32),
            count=np.zeros(particles, np.int64),
            seen=np.zeros((particles, rows * columns), np.uint8),
        )

    @property
    def tiles_in_use(self) -> int:
        """Tiles that at least one particle refers to."""
        return len(self.references) - 1 - self._free_count

    @property
    def bytes_in_use(self) -> int:
        """Memory of the tiles in use and of the tables [bytes]."""
        per_tile = sum(array.dtype.itemsize * array.shape[1] for array in self.data)
        return self.tiles_in_use * per_tile + self.table.nbytes

    def extend(self, below: int, above: int, left: int, right: int) -> None:
        """Add that many rows and columns of tiles at the four sides of all tables."""
        self.table = np.pad(self.table, ((0, 0), (below, above), (left, right)))
        self.request = self._empty_request()

    def copy_on_write(self, threads: Threads) -> None:
        """Give the particles copies of their own of all tiles in `request`, and empty it."""
        wanted = int(self.request.count.sum())  # at most: some are private already
        if wanted > self._free_count:
            wanted = copies_needed(self.table, self.references, self.request)
            if wanted > self._free_count:
                self._grow(wanted - self._free_count)
        copies = np.empty((wanted, 2), np.int32)
        count, self._free_count = copy_on_write(
            self.table, self.references, self._free, self._free_count, self.request, copies
        )
        for array in self.data:
            if count < MIN_SHARED_COPIES:
                copy_tiles(0, count, array, copies)
            else:
                threads.run(copy_tiles, count, array, copies)

    def _grow(self, missing: int) -> None:
        """Enlarge the pool by 3 %, in place: the system moves large blocks without a second copy of them."""
        old = len(self.references)
        new = old + max(missing, old // 32, 64)
        self.references = np.concatenate([self.references, np.zeros(new - old, np.int32)])
        for array in self.data:
            if new > len(array):
                array.resize((new, array.shape[1]), refcheck=False)  # nobody keeps a view beyond a call
        free = np.empty(new, np.int32)
        free[: self._free_count] = self._free[: self._free_count]
        free[self._free_count : self._free_count + new - old] = np.arange(new - 1, old - 1, -1)
        self._free, self._free_count = free, self._free_count + new - old

    def inherit(self, ancestors: NDArray[np.int64]) -> None:
        """Let particle i take over the table of particle `ancestors[i]`, (offspring,); tiles are shared, not copied."""
        resized = len(ancestors) != len(self.table)
        self.table = np.ascontiguousarray(self.table[ancestors])
        self._free_count = count_owners(self.table, self.references, self._free)
        if resized:
            self.request = self._empty_request()

    def state(self, name: str) -> dict[str, NDArray[Any]]:
        """The whole pool, as arrays whose names begin with `name`; copies, since a pool that grows moves its tiles."""
        return {
            f"{name}_table": self.table.copy(),
            f"{name}_references": self.references.copy(),
            f"{name}_free": self._free[: self._free_count].copy(),
            **{f"{name}_data{k}": array[: len(self.references)].copy() for k, array in enumerate(self.data)},
        }

    def restore(self, name: str, state: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `state` gave."""
        self.table, self.references = np.array(state[f"{name}_table"]), np.array(state[f"{name}_references"])
        self.data = [np.array(state[f"{name}_data{k}"]) for k in range(len(self.data))]
        free = state[f"{name}_free"]
        self._free_count = len(free)
        self._free = np.zeros(len(self.references), np.int32)
        self._free[: self._free_count] = free
        self.request = self._empty_request()
