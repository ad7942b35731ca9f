# SPDX-License-Identifier: MIT
"""Frontiers: where known free floor ends and the unknown begins.

Source: B. Yamauchi, A frontier-based approach for autonomous exploration, CIRA 1997.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from testbed.exploration.planning.floor import Cell, Floor, Ways

SMALLEST = 0.4
"""Frontiers shorter than this are gaps between beams [m]."""
_SIGHT = 0.5
"""A frontier is reached from cells within this [m]: its own cells are often too close to a wall to stand in."""


class Frontier(NamedTuple):
    """One stretch of the border of the known."""

    goal: Cell
    """The cell to drive to: the one near the frontier's middle that can be reached."""
    cost: float
    """Of the way there [m], see `Ways.costs`."""
    length: float
    """Of the frontier [m]."""


def border_of(floor: Floor) -> NDArray[np.bool_]:
    """Free cells beside unknown ones, (rows, cols)."""
    border: NDArray[np.bool_] = floor.free & ndimage.binary_dilation(floor.unknown)
    return border


def find_frontiers(floor: Floor, ways: Ways) -> list[Frontier]:
    """All frontiers that can be reached and are long enough, in the order of the grid."""
    labels, _ = ndimage.label(border_of(floor), np.ones((3, 3)))
    reach = round(_SIGHT / floor.cell)
    found = []
    for label, (rows, cols) in enumerate(ndimage.find_objects(labels), start=1):
        low = max(rows.start - reach, 0), max(cols.start - reach, 0)
        window = np.s_[low[0] : rows.stop + reach, low[1] : cols.stop + reach]
        cells = labels[window] == label
        length = int(cells.sum()) * floor.cell
        if length < SMALLEST:
            continue
        costs = ways.costs[window]
        away = ndimage.distance_transform_edt(~cells)
        near = np.argwhere(np.isfinite(costs) & (away <= reach))
        if len(near) == 0:
            continue
        middle = np.argwhere(cells).mean(axis=0)
        row, col = near[np.argmin(((near - middle) ** 2).sum(axis=1))].tolist()
        found.append(Frontier((row + low[0], col + low[1]), float(costs[row, col]), length))
    return found
