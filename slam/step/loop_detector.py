# SPDX-License-Identifier: MIT
"""Detects when a robot comes back to an area that it left long ago: the moment at which a loop closes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from slam.se2 import Pose


class LoopDetector:
    """Detects loops by the distance travelled since each square of the map was last visited; it closes none."""

    SQUARE = 1.5
    """Side of a square [m]."""
    LOOP = 15.0
    """Distance travelled since the last visit that makes a return a loop [m]."""

    def __init__(self) -> None:
        self._visited: dict[tuple[int, int], float] = {}
        self._travelled = 0.0
        self._last_return = -self.LOOP

    def update(self, pose: Pose, distance: float) -> bool:
        """Whether the robot at `pose` (3,), after driving `distance` [m], has just closed a loop.

        True once per loop: not again until the robot has spent `LOOP` metres without a return.
        """
        self._travelled += distance
        square = (math.floor(pose[0] / self.SQUARE), math.floor(pose[1] / self.SQUARE))
        last = self._visited.get(square)
        self._visited[square] = self._travelled
        if last is None or self._travelled - last < self.LOOP:
            return False
        new = self._travelled - self._last_return >= self.LOOP
        self._last_return = self._travelled
        return new

    def state(self) -> dict[str, Any]:
        """Everything remembered, as plain values."""
        return {
            "visited": [[*square, when] for square, when in self._visited.items()],
            "travelled": self._travelled,
            "last_return": self._last_return,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._visited = {(column, row): when for column, row, when in state["visited"]}
        self._travelled, self._last_return = state["travelled"], state["last_return"]
