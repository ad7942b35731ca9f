# SPDX-License-Identifier: MIT
"""Four particles side by side: the best, the lightest, and the two whose maps differ most.

The map of the best is on the main map already. Those of the other three come in pixels of `COARSE` x `COARSE` cells:
they are drawn small, side by side, and each one differs from the one before it nearly everywhere by a little.
"""

from __future__ import annotations

import numpy as np

from testbed.views.map_cells import MapCells
from testbed.views.rerun import entities
from testbed.views.rerun.layers._tile_kernels import count_differences
from testbed.views.rerun.layers.map_tiles import ImagePool, MapTiles
from testbed.views.rerun.layers.path_blocks import PathBlocks
from testbed.views.view import Snapshot

COARSE = 2
"""Cells along the side of a pixel of the maps."""


class Slot:
    """One of the four, and what was last sent of it."""

    def __init__(self, rank: str, pool: ImagePool) -> None:
        """Nothing was sent yet; pool: where the images of maps are."""
        self.entity = f"{entities.COMPARE}/{rank}"
        self.tiles, self.path = MapTiles(pool, COARSE), PathBlocks()


def slots(pool: ImagePool) -> list[Slot]:
    """The four slots, in the order of `chosen`."""
    return [Slot(rank, pool) for rank in entities.RANKS]


def chosen(snapshot: Snapshot) -> list[int]:
    """Numbers of the particles for the four slots."""
    assert snapshot.weights is not None
    assert snapshot.cells is not None
    return [
        snapshot.best,
        int(np.argmin(snapshot.weights)),
        *most_different(snapshot.cells(snapshot.best), snapshot.best),
    ]


def most_different(cells: MapCells, best: int) -> tuple[int, int]:
    """Two particles whose maps differ in many walls: the one that differs most from the best, and the one that differs
    most from that. All pairs would take too long.
    """
    differences = np.zeros(len(cells.tables), np.int64)
    count_differences(cells.tables, cells.walls, best, differences)
    first = int(np.argmax(differences))
    count_differences(cells.tables, cells.walls, first, differences)
    return first, int(np.argmax(differences))
