# SPDX-License-Identifier: MIT
"""Four particles side by side: the best, the lightest, and the two whose histories differ most."""

from __future__ import annotations

import numpy as np

from testbed.views.rerun import entities
from testbed.views.rerun.layers.map_tiles import MapTiles
from testbed.views.rerun.layers.path_blocks import PathBlocks
from testbed.views.view import Snapshot


class Slot:
    """One of the four, and what was last sent of it."""

    def __init__(self, rank: str) -> None:
        """Nothing was sent yet."""
        self.entity = f"{entities.COMPARE}/{rank}"
        self.tiles, self.path = MapTiles(), PathBlocks()


def slots() -> list[Slot]:
    """The four slots, in the order of `chosen`."""
    return [Slot(rank) for rank in entities.RANKS]


def chosen(snapshot: Snapshot, most_different: tuple[int, int]) -> list[int]:
    """Numbers of the particles for the four slots."""
    assert snapshot.weights is not None
    last = len(snapshot.weights) - 1
    a, b = (min(number, last) for number in most_different)
    return [snapshot.best, int(np.argmin(snapshot.weights)), a, b]
