# SPDX-License-Identifier: MIT
"""What the viewer shows at a time: the map, put together from the squares of a recording, and the path from blocks."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from slam.occupancy import OccupancyGrid
from testbed.views.map_cells import FREE_FROM, OCCUPIED_TO, UNKNOWN
from testbed.views.rerun import entities
from testbed.views.rerun.layers.map_tiles import SQUARE

UNSEEN, FREE, OCCUPIED = 0, 1, 2


def rows(
    path: Path, entity: str, column: str, static: bool = False, timeline: str = entities.TIMELINE
) -> list[tuple[float, Any]]:
    """(time [s] or step, value) of each row of a component, in the order of time; time 0 where static."""
    found = []
    for chunk in rr.chunk.RrdReader(path).stream().filter(content=entity, is_static=static):
        batch = chunk.to_record_batch()
        if column in batch.schema.names:
            times = [0.0] * len(batch)
            if not static:
                times = [getattr(t, "total_seconds", lambda t=t: t)() for t in batch.column(timeline).to_pylist()]
            values = batch.column(column).to_pylist()
            found += [(t, v) for t, v in zip(times, values, strict=True) if v is not None]
    return sorted(found, key=lambda row: row[0])


def views(path: Path, component: str) -> dict[str, Any]:
    """A component of each view of a recording by the view's name; None where the view has none."""
    reader = rr.chunk.RrdReader(path)
    (store,) = reader.blueprints()
    names, values = {}, {}
    for chunk in reader.stream(store=store):
        row, view = chunk.to_record_batch().to_pydict(), str(chunk.entity_path).split("/")[2:3]
        if "ViewBlueprint:display_name" in row:
            names[view[0]] = row["ViewBlueprint:display_name"][0][0]
        if row.get(component):
            values[view[0]] = row[component][0][0]
    return {name: values.get(view) for view, name in names.items()}


class ShownPath:
    """All blocks of one path in a recording."""

    def __init__(self, recording: Path, parent: str = entities.PATH) -> None:
        names = {str(name) for name in rr.chunk.RrdReader(recording).store().schema().entity_paths()}
        blocks = sorted((int(name.rsplit("_", 1)[1]), name) for name in names if name.startswith(f"{parent}/block_"))
        self._blocks = [rows(recording, name, "LineStrips3D:strips") for _, name in blocks]

    def at(self, time: float) -> np.ndarray:
        """Positions of the path as it is shown at a time [s], (poses, 2); a block begins with the last one's end."""
        shown = np.zeros((0, 2), np.float32)
        for block in self._blocks:
            strips = [value for when, value in block if when <= time + 1e-6]
            if strips and strips[-1] and len(strips[-1][0]):
                part = np.array(strips[-1][0], np.float32)[:, :2]
                shown = np.concatenate([shown[:-1], part])
        return shown


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
        """Kinds of the cells of `grid`, as large as pixels, as they are shown at a time [s], (rows, cols)."""
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


def coarse_kinds(grid: OccupancyGrid, coarse: int) -> tuple[OccupancyGrid, np.ndarray]:
    """A grid whose cells are `coarse` times as large, counted from the map's origin, and their kinds: occupied where
    one of the small ones is, else free where one is, (rows, cols)."""
    first = np.rint(np.array(grid.origin[:2]) / grid.resolution).astype(int)
    (left, low), (rows, cols) = first % coarse, grid.probability.shape
    above, right = -(rows + low) % coarse, -(cols + left) % coarse
    small = np.pad(kinds(grid), ((low, above), (left, right)))  # UNSEEN < FREE < OCCUPIED
    large = small.reshape(small.shape[0] // coarse, coarse, small.shape[1] // coarse, coarse).max(axis=(1, 3))
    x, y = (first - (left, low)) * grid.resolution
    size = coarse * grid.resolution
    return OccupancyGrid(probability=np.zeros(large.shape, np.float32), resolution=size, origin=(x, y, 0.0)), large


def kinds(grid: OccupancyGrid) -> np.ndarray:
    """Kinds of the cells of a map, (rows, cols)."""
    return np.where(~grid.known, UNSEEN, np.where(np.nan_to_num(grid.probability) < 0.5, FREE, OCCUPIED))
