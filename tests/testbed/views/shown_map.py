# SPDX-License-Identifier: MIT
"""The map that the viewer shows at a time, put together from the squares of a recording."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import rerun as rr

from slam.occupancy import OccupancyGrid
from testbed.views.map_cells import FREE_FROM, OCCUPIED_TO, UNKNOWN
from testbed.views.rerun import entities
from testbed.views.rerun.layers.map_tiles import SQUARE

UNSEEN, FREE, OCCUPIED = 0, 1, 2


class ShownMap:
    """All squares of one map in a recording."""

    def __init__(self, recording: Path, parent: str = entities.MAP) -> None:
        self._squares: dict[tuple[int, int], list[tuple[float, np.ndarray]]] = {}
        for chunk in rr.chunk.RrdReader(recording).stream().filter(content=f"{parent}/**", is_static=False):
            batch = chunk.to_record_batch()
            place = re.search(r"square_(-?\d+)_(-?\d+)$", str(chunk.entity_path))
            if place is None or "GridMap:data" not in batch.schema.names:
                continue
            rows = self._squares.setdefault((int(place[1]), int(place[2])), [])
            times = [time.total_seconds() for time in batch.column(entities.TIMELINE).to_pylist()]
            for time, value in zip(times, batch.column("GridMap:data").to_pylist(), strict=True):
                rows.append((time, np.frombuffer(bytes(value[0]), np.uint8).reshape(SQUARE, SQUARE)[::-1]))

    @property
    def rows(self) -> int:
        """Squares that were sent."""
        return sum(map(len, self._squares.values()))

    def at(self, time: float, grid: OccupancyGrid) -> np.ndarray:
        """Kinds of the cells of `grid` as they are shown at a time [s], (rows, cols)."""
        corner = np.rint(np.array(grid.origin[:2]) / grid.resolution).astype(int)
        rows, cols = grid.probability.shape
        grey = np.full((rows, cols), UNKNOWN, np.uint8)
        for (column, row), images in self._squares.items():
            shown = [image for when, image in images if when <= time + 1e-6]
            if not shown:
                continue
            left, low = column * SQUARE - corner[0], row * SQUARE - corner[1]
            inside = np.s_[max(low, 0) : max(low + SQUARE, 0), max(left, 0) : max(left + SQUARE, 0)]
            part = grey[inside]
            from_row, from_col = max(-low, 0), max(-left, 0)
            part[:] = shown[-1][from_row : from_row + part.shape[0], from_col : from_col + part.shape[1]]
        return np.where(grey >= FREE_FROM, FREE, np.where(grey <= OCCUPIED_TO, OCCUPIED, UNSEEN))


def kinds(grid: OccupancyGrid) -> np.ndarray:
    """Kinds of the cells of a map, (rows, cols)."""
    return np.where(~grid.known, UNSEEN, np.where(np.nan_to_num(grid.probability) < 0.5, FREE, OCCUPIED))
