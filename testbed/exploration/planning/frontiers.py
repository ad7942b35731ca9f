# SPDX-License-Identifier: MIT
"""Frontiers: the borders between known free floor and unknown space.

Source: B. Yamauchi, A frontier-based approach for autonomous exploration, CIRA 1997.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from testbed.exploration.planning.floor import Cell, Floor, ShortestPaths

MIN_LENGTH = 0.4
"""Shorter frontiers are ignored, because they are gaps between beams [m]."""
_GOAL_REACH = 0.5
"""Goals lie up to this far from their frontier [m], whose own cells are often too near to a wall."""


class Frontier(NamedTuple):
    """One connected frontier."""

    goal: Cell
    """The cell to drive to: the reachable one nearest to the centre of the frontier."""
    cost: float
    """Cost of the path to `goal` [m], see `ShortestPaths.costs`."""
    length: float
    """Length of the frontier [m]."""


def border_of(floor: Floor) -> NDArray[np.bool_]:
    """Return the free cells next to unknown ones, (rows, cols)."""
    border: NDArray[np.bool_] = floor.free & ndimage.binary_dilation(floor.unknown)
    return border


def find_frontiers(floor: Floor, paths: ShortestPaths) -> list[Frontier]:
    """Return all frontiers that can be reached and are long enough, in the order of the grid."""
    labels, _ = ndimage.label(border_of(floor), np.ones((3, 3)))
    reach = round(_GOAL_REACH / floor.cell)
    found = []
    for label, (rows, cols) in enumerate(ndimage.find_objects(labels), start=1):
        low = max(rows.start - reach, 0), max(cols.start - reach, 0)
        window = np.s_[low[0] : rows.stop + reach, low[1] : cols.stop + reach]
        cells = labels[window] == label
        length = int(cells.sum()) * floor.cell
        if length < MIN_LENGTH:
            continue
        costs = paths.costs[window]
        away = ndimage.distance_transform_edt(~cells)
        near = np.argwhere(np.isfinite(costs) & (away <= reach))
        if len(near) == 0:
            continue
        centre = np.argwhere(cells).mean(axis=0)
        row, col = near[np.argmin(((near - centre) ** 2).sum(axis=1))].tolist()
        found.append(Frontier((row + low[0], col + low[1]), float(costs[row, col]), length))
    return found
