# SPDX-License-Identifier: MIT
"""The grid maps of all particles: counts, sub-cell surface and nearest-wall field, in shared tiles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam._threads import Threads
from slam.config import MapConfig
from slam.grid._cell_kernels import HIT_SHIFT, HITS, VISITS
from slam.grid._distance_field_kernels import integrate_scan_and_request_field_tiles, update_fields
from slam.grid._tile_kernels import FINE_SIDE, SHIFT, SIDE
from slam.grid._traversal_kernels import bounds_of_rays
from slam.grid._update_kernels import request_scan_tiles
from slam.grid.distance_field import MAX_RADIUS, make_offset_table, smallest_type
from slam.grid.tile_pool import TilePool
from slam.occupancy import OccupancyGrid, occupancy_probability
from slam.sensor.rays import Rays

MAX_TABLE_TILES = 1 << 22
"""Tiles that the table of one particle may span; at 0.05 m cells a square of 1.6 km."""


class GridArrays(NamedTuple):
    """The maps of all particles, each part with tables (particles, rows, columns) of its tile numbers."""

    table: NDArray[np.int32]
    """Tiles of `counts` and `walls`: wherever a beam has been."""
    counts: NDArray[np.uint16]
    """Counts words, see `_cell_kernels`, (tiles, SIDE * SIDE)."""
    walls: NDArray[np.uint16]
    """Which cells are walls: bit x of word y of a tile, (tiles, SIDE)."""
    surface_table: NDArray[np.int32]
    """Fine tiles of `surface`: where beams have ended."""
    surface: NDArray[np.uint32]
    """Surface words, see `_cell_kernels`, (tiles, FINE_SIDE * FINE_SIDE)."""
    field_table: NDArray[np.int32]
    """Tiles of `nearest`: within the field's radius of walls."""
    nearest: NDArray[np.uint8] | NDArray[np.uint16]
    """Field words, see `_distance_field_kernels`, (tiles, SIDE * SIDE)."""
    offset: NDArray[np.int64]
    """Offset dx, dy of each field word [cells], (words, 2)."""
    step: NDArray[np.int32]
    """The same as a step, see `_cell_kernels`, (words,)."""
    corner: NDArray[np.int64]
    """Cell number in x and in y of the tables' corner, counted from the map's origin, (2,)."""
    cell: float
    """Side of a cell [m]."""
    per_cell: float
    """1 / cell [1/m]."""


class Changes(NamedTuple):
    """Cells that became walls or ceased to be in the last scan."""

    cells: NDArray[np.int64]
    """Cells as `packed`, each once, (particles, m); the first `filled` of each row are valid."""
    filled: NDArray[np.int64]
    """How many entries of each row are valid, (particles,)."""


class ParticleMaps:
    """One occupancy grid per particle; grows where the beams go."""

    def __init__(self, particles: int, config: MapConfig, threads: Threads) -> None:
        """Empty maps.

        Raises:
            ValueError: the field's radius is less than one cell or more than 63.
        """
        self.config = config
        self.threads = threads
        radius = round(config.field_radius / config.cell)
        if not 1 <= radius <= MAX_RADIUS:
            raise ValueError(
                f"MapConfig.field_radius must be 1 to {MAX_RADIUS} cells of {config.cell} m, "
                f"got {config.field_radius} m"
            )
        self._offsets = make_offset_table(radius)
        cells = SIDE * SIDE
        word = smallest_type(len(self._offsets.offset))
        self._counts = TilePool(particles, [(np.uint16, cells), (np.uint16, SIDE)])
        self._surface = TilePool(particles, [(np.uint32, FINE_SIDE * FINE_SIDE)])
        self._field = TilePool(particles, [(word, cells)])
        self._corner = np.zeros(2, np.int64)
        self.scans = 0
        """Scans that were counted into the maps."""
        self.touched: NDArray[np.int64] = np.zeros((0, 0), np.int64)
        """Number of the last scan, counted from 1, that has changed each tile in any map, (rows, columns) of the table;
        0 = none has yet."""

    @property
    def _pools(self) -> tuple[TilePool, TilePool, TilePool]:
        return self._counts, self._surface, self._field

    @property
    def grids(self) -> GridArrays:
        """The arrays that the kernels read; valid until the next change of the maps."""
        counts, walls = self._counts.data
        return GridArrays(
            self._counts.table,
            counts,
            walls,
            self._surface.table,
            self._surface.data[0],
            self._field.table,
            self._field.data[0],
            self._offsets.offset,
            self._offsets.step,
            self._corner,
            self.config.cell,
            1.0 / self.config.cell,
        )

    @property
    def bytes_in_use(self) -> int:
        """Memory of all maps together [bytes]."""
        return sum(pool.bytes_in_use for pool in self._pools)

    def integrate_scan(self, poses: se2.Pose, rays: Rays) -> None:
        """Count one scan into every map; poses (particles, 3) of the robot in the map's frame.

        Raises:
            ValueError: the map would become larger than `MAX_TABLE_TILES` tiles; it is then as it was before.
        """
        particles = len(poses)
        self._make_room(poses, rays)
        crossed, ended = self._counts.request, self._surface.request
        self.threads.run(request_scan_tiles, particles, self.grids, poses, rays, crossed, ended)
        self.scans += 1
        self.touched[np.maximum.reduce(crossed.seen, axis=0).reshape(self.touched.shape) != 0] = self.scans
        self._counts.copy_on_write(self.threads)
        self._surface.copy_on_write(self.threads)
        room = 512 + 2 * len(rays.hit)
        changes = Changes(np.empty((particles, room), np.int64), np.zeros(particles, np.int64))
        share, radius, near = self.config.wall_share, self._offsets.radius, self._field.request
        self.threads.run(
            integrate_scan_and_request_field_tiles, particles, self.grids, poses, rays, share, changes, radius, near
        )
        self._field.copy_on_write(self.threads)
        self.threads.run(update_fields, particles, self.grids, changes, self._offsets)

    def _make_room(self, poses: se2.Pose, rays: Rays) -> None:
        """Extend the tables to all ends of the rays from poses (particles, 3), and to the fields about them."""
        margin, tile = self._offsets.radius * self.config.cell, SIDE * self.config.cell
        x0, y0, x1, y1 = bounds_of_rays(poses, rays)  # too short to wake a thread for
        left, below = (x0 - margin) / tile, (y0 - margin) / tile
        right, above = (x1 + margin) / tile, (y1 + margin) / tile
        rows, columns = self._counts.table.shape[1:]
        x, y = int(self._corner[0]) >> SHIFT, int(self._corner[1]) >> SHIFT
        if not (x <= left and y <= below and right < x + columns and above < y + rows):  # also where one is NaN
            self._extend(np.floor([left, below]), np.floor([right, above]))

    def _extend(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
        """Extend the tables to the tiles from `low` (2,) to `high` (2,), counted in tiles from the map's origin.

        Raises:
            ValueError: the tables would become larger than `MAX_TABLE_TILES` tiles, or a bound is not finite.
        """
        tile = SIDE * self.config.cell
        size = np.array(self._counts.table.shape[:0:-1])  # columns, rows
        first = self._corner >> SHIFT if size.all() else low
        new_first, last = np.minimum(first, low), np.maximum(first + size - 1, high)
        columns, rows = (last - new_first + 1).tolist()
        if not columns * rows <= MAX_TABLE_TILES:  # also where a reading or pose is not finite
            raise ValueError(
                f"the map would span {columns * tile:.3g} x {rows * tile:.3g} m, more than {MAX_TABLE_TILES} tiles "
                f"of {tile:g} m: is there a jump in the odometry, or a reading beyond all range?"
            )
        left, below = (int(n) for n in first - new_first)
        right, above = (int(n) for n in last - (first + size - 1))
        for pool, per_tile in zip(self._pools, (1, SIDE // FINE_SIDE, 1), strict=True):
            pool.extend(below * per_tile, above * per_tile, left * per_tile, right * per_tile)
        self.touched = np.pad(self.touched, ((below, above), (left, right)))
        self._corner = new_first.astype(np.int64) << SHIFT

    def inherit(self, ancestors: NDArray[np.int64]) -> None:
        """Let particle i continue with the map of particle `ancestors[i]`; any number of offspring, (offspring,)."""
        for pool in self._pools:
            pool.inherit(ancestors)

    def state(self) -> dict[str, NDArray[Any]]:
        """All maps, as arrays."""
        return {
            "map_corner": self._corner.copy(),
            "map_scans": np.array(self.scans),
            "map_touched": self.touched.copy(),
            **self._counts.state("counts"),
            **self._surface.state("surface"),
            **self._field.state("field"),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `state` gave."""
        self._corner = np.array(state["map_corner"])
        self._counts.restore("counts", state)
        self._surface.restore("surface", state)
        self._field.restore("field", state)
        self.scans, self.touched = int(state["map_scans"]), np.array(state["map_touched"])

    def occupancy(self, particle: int) -> OccupancyGrid:
        """The map of one particle, cut to what was observed."""
        counts = self._dense(particle)
        rows = np.flatnonzero(counts.any(axis=1))
        columns = np.flatnonzero(counts.any(axis=0))
        if len(rows) == 0:
            raise ValueError("the map is empty: no scan was taken in")
        counts = counts[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        cell = self.config.cell
        return OccupancyGrid(
            probability=probability_of_counts(counts, self.config.occupied_share),
            resolution=cell,
            origin=(
                float(self._corner[0] + columns[0]) * cell,
                float(self._corner[1] + rows[0]) * cell,
                0.0,
            ),
        )

    def _dense(self, particle: int) -> NDArray[np.uint16]:
        """Counts words of one particle's whole table, (rows, columns) of cells."""
        table = self._counts.table[particle]
        tiles = self._counts.data[0][table].reshape(*table.shape, SIDE, SIDE)
        dense: NDArray[np.uint16] = tiles.swapaxes(1, 2).reshape(table.shape[0] * SIDE, table.shape[1] * SIDE)
        return dense


def probability_of_counts(counts: NDArray[np.uint16], occupied_share: float) -> NDArray[np.float32]:
    """P(occupied) of counts words (see `_cell_kernels`), any shape; NaN where a cell was never visited."""
    return occupancy_probability((counts >> HIT_SHIFT) & HITS, counts & VISITS, occupied_share)
