# SPDX-License-Identifier: MIT
"""Find the floor of a building on a map: known, inside of its walls, and connected with the place to start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from worlds.errors import WorldError

MAX_SPECK = 0.25
"""Unknown areas up to this size that touch known floor count as floor: no lidar beam crossed them by chance [m²]."""
CLEARANCE = 0.25
"""Floor is connected where a robot of this radius can drive [m]."""
_MIN_INSIDE = 1.0
"""Smallest floor inside of walls [m²]; with less the map shows no building, and all of its floor is kept."""
_MIN_DIRECTIONS = 6
"""Directions of eight in which a cell inside of a building sees something solid: all but one or two through a gap."""
_SMALL_SHARE = 0.1
"""A building whose floor covers less than this share of the page adds a note."""
_SEPARATE_SHARE = 0.05
"""Separate floor of more than this share of all floor adds a note."""


@dataclass(frozen=True, eq=False)
class Floor:
    """Floor on a map."""

    free: NDArray[np.bool_]
    """Cells of the floor, (rows, cols); everything else is solid."""
    start: tuple[int, int]
    """Cell (row, col) farthest from everything solid, in the largest connected part of the floor."""
    notes: tuple[str, ...]
    """What was left out, with its area."""


def find_floor(free: NDArray[np.bool_], unknown: NDArray[np.bool_], resolution: float) -> Floor:
    """Find the floor among `free` and `unknown` cells (rows, cols) with sides of `resolution` [m].

    Free cells around the building, which surround it up to most of the page's border, are left out: a white margin.
    Where the building is open towards them, only cells with something solid in most directions are kept.
    Raises WorldError where no cell is free.
    """
    if not free.any():
        raise WorldError("no free cell, expected free floor")
    area = resolution**2
    notes = []
    kept = free | _specks(free, unknown, MAX_SPECK / area)
    outside = _outside(kept)
    if outside is not None:
        inside = kept & ~outside | (outside & _enclosed(~kept))
        if inside.sum() * area >= _MIN_INSIDE:
            left_out = float((kept & ~inside).sum() * area)
            opened = inside & outside
            kept = inside
            notes.append(f"{left_out:.0f} m² of free cells outside of the walls are left out, like a white margin")
            if opened.sum() * area >= _MIN_INSIDE:
                leak = f"{opened.sum() * area:.0f} m² of floor are open towards the outside"
                notes.append(f"{leak}: the gap in the walls is closed")
    start, connected = _start(kept, resolution)
    if (separate := float(kept.sum() - connected) * area) > _SEPARATE_SHARE * kept.sum() * area:
        notes.append(f"{separate:.1f} m² of floor are not connected with the start")
    if kept.sum() < _SMALL_SHARE * kept.size:
        notes.append(f"the floor covers {kept.sum() * area:.0f} m² of a page of {kept.size * area:.0f} m²")
    return Floor(kept, start, tuple(notes))


def _specks(free: NDArray[np.bool_], unknown: NDArray[np.bool_], most_cells: float) -> NDArray[np.bool_]:
    """Return the unknown areas of at most so many cells that touch free cells."""
    labels, count = ndimage.label(unknown)
    small = np.bincount(labels.ravel(), minlength=count + 1) <= most_cells
    touching = np.zeros(count + 1, dtype=np.bool_)
    touching[np.unique(labels[ndimage.binary_dilation(free)])] = True
    chosen = small & touching
    chosen[0] = False
    specks: NDArray[np.bool_] = chosen[labels]
    return specks


def _outside(free: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    """Return the connected free cells that take more than half of the page's border; None where there are none."""
    border = np.zeros_like(free)
    border[[0, -1]] = border[:, [0, -1]] = True
    labels, count = ndimage.label(free)
    on_border = np.bincount(labels[border], minlength=count + 1)
    on_border[0] = 0
    largest = int(np.argmax(on_border))
    return labels == largest if on_border[largest] > 0.5 * border.sum() else None


def _enclosed(solid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells from which something solid is seen in most of the eight directions of the page, (rows, cols)."""
    directions = np.zeros(solid.shape, dtype=np.uint8)
    for step in (1, -1):
        directions[:, ::step] += np.logical_or.accumulate(solid[:, ::step], axis=1)
        for left, right in ((np.s_[:], np.s_[:]), (np.s_[1:], np.s_[:-1]), (np.s_[:-1], np.s_[1:])):
            seen = solid[::step].copy()
            for row in range(1, len(seen)):
                seen[row, left] |= seen[row - 1, right]
            directions[::step] += seen
    enclosed: NDArray[np.bool_] = directions >= _MIN_DIRECTIONS
    return enclosed


def _start(free: NDArray[np.bool_], resolution: float) -> tuple[tuple[int, int], int]:
    """Return the cell farthest from everything solid in the largest connected part, and the number of its cells."""
    rows, cols = (np.flatnonzero(free.any(axis=axis)) for axis in (1, 0))
    low, part = (int(rows[0]), int(cols[0])), free[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    distance = ndimage.distance_transform_edt(np.pad(part, 1))[1:-1, 1:-1]
    wide, count = ndimage.label(distance * resolution > CLEARANCE)
    if count:
        largest = int(np.argmax(np.bincount(wide.ravel())[1:])) + 1
        inside = wide == largest
    else:
        inside = part
    row, col = np.unravel_index(int(np.argmax(np.where(inside, distance, 0.0))), part.shape)
    labels, _ = ndimage.label(part)
    return (int(row) + low[0], int(col) + low[1]), int((labels == labels[row, col]).sum())
