# SPDX-License-Identifier: MIT
"""Detects when a robot sees an area again that it left long ago: the moment at which a loop closes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


class LoopDetector:
    """Detects loops by how far the robot had driven since walls were last seen when it saw them again; it closes none.

    Coming back, a robot sees the first of the old walls from afar, and more of them with each scan: a wall counts as
    found again until it has been out of sight for `LOOP` metres once more.
    """

    LOOP = 15.0
    """Distance driven since walls were last seen that makes seeing them again a loop [m]."""
    SHARE = 0.25
    """Share of the hits on such walls with which a loop closes: a few beams through a door do not close one."""
    SQUARE = 0.4
    """Side of the squares in which walls are remembered [m]."""

    def __init__(self) -> None:
        self._seen: dict[
            tuple[int, int], tuple[float, float]
        ] = {}  # distance at the last sight, length of its loop [m]
        self._travelled = 0.0
        self._last_return = -self.LOOP

    def update(self, hits: NDArray[np.float64], distance: float) -> float:
        """Length of the loop that a scan closes [m]; 0 where it closes none.

        hits (n, 2) end points in the map's frame [m];  distance: driven since the scan before [m]
        A loop is reported once: not again until the robot has driven `LOOP` metres without such a return.
        """
        self._travelled += distance
        squares, counts = np.unique(np.floor(hits / self.SQUARE).astype(np.int64), axis=0, return_counts=True)
        loops = np.array([self._see((column, row)) for column, row in squares.tolist()])
        old = loops > 0.0
        if len(loops) == 0 or counts[old].sum() < self.SHARE * counts.sum():
            return 0.0
        new = self._travelled - self._last_return >= self.LOOP
        self._last_return = self._travelled
        return float(np.median(loops[old])) if new else 0.0

    def _see(self, square: tuple[int, int]) -> float:
        """Note that a wall in a square is seen; length of the loop by which it was found again [m], 0 = by none."""
        last, loop = self._seen.get(square, (self._travelled, 0.0))
        gone = self._travelled - last
        loop = gone if gone >= self.LOOP else loop
        self._seen[square] = self._travelled, loop
        return loop

    def state(self) -> dict[str, Any]:
        """Everything remembered, as plain values."""
        seen = [[*square, *values] for square, values in self._seen.items()]
        return {"seen": seen, "travelled": self._travelled, "last_return": self._last_return}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._seen = {(column, row): (last, loop) for column, row, last, loop in state["seen"]}
        self._travelled, self._last_return = state["travelled"], state["last_return"]
