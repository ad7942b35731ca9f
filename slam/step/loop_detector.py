# SPDX-License-Identifier: MIT
"""Detects when a robot comes back to an area that it left long ago: the moment at which a loop closes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose

Square = tuple[int, int]
"""Column and row."""


class Loop(NamedTuple):
    """What a scan says of loops."""

    length: float = 0.0
    """Length of the loop that the scan closes [m]: driven since the walls that it sees, or the place where the robot
    is, were last seen; 0 = it closes none."""
    at_place: bool = False
    """Whether the robot is back at a place where it was; else it sees walls again that it saw from there."""


class LoopDetector:
    """Detects loops by how far the robot had driven since walls were last seen when it saw them again, and since it was
    last at a place when it came back there; it closes none.

    Coming back, a robot sees the first of the old walls from afar, and more of them with each scan: a wall counts as
    found again until it has been out of sight for `LOOP` metres once more. The walls that it sees first are often the
    ones that it saw last before, across a hall or through a door; a place that it reaches later closes a longer loop.
    """

    LOOP = 15.0
    """Distance driven since walls were last seen that makes seeing them again a loop [m]."""
    SHARE = 0.25
    """Share of the hits on such walls with which a loop closes: a few beams through a door do not close one."""
    SQUARE = 0.4
    """Side of the squares in which walls are remembered [m]."""
    PLACE = 2.0 / 3.0
    """Side of the squares in which places are remembered [m]: the robot is at a place if it is in its square or in one
    of the eight about it, about a metre around."""

    def __init__(self) -> None:
        self._walls, self._places = Sightings(self.LOOP), Sightings(self.LOOP)
        self._travelled = 0.0
        self._last_return = -self.LOOP
        self._closed = Loop()  # the longest of the return that goes on

    def update(self, hits: NDArray[np.float64], pose: Pose, distance: float) -> Loop:
        """Take in a scan and find the loop that it closes.

        hits (n, 2) end points in the map's frame [m];  pose (3,) of the robot there
        distance: driven since the scan before [m]
        A loop closes with the first scan that sees enough old walls, and again, once, when the robot is back at a place
        and has driven further since it was there, or when the loop has become `LOOP` metres longer. The next one closes
        after the robot has driven `LOOP` metres without old walls.
        """
        self._travelled += distance
        squares, counts = _distinct(np.floor(hits / self.SQUARE).astype(np.int64))
        loops = np.array(self._walls.see(squares, self._travelled))
        x, y = np.floor(np.asarray(pose[:2]) / self.PLACE).astype(int).tolist()
        around = product((x, x - 1, x + 1), (y, y - 1, y + 1))  # that of the robot comes first
        place = self._places.see(around, self._travelled)[0]
        old = loops > 0.0
        if len(loops) == 0 or counts[old].sum() < self.SHARE * counts.sum():
            return Loop()
        if self._travelled - self._last_return >= self.LOOP:
            self._closed = Loop()
        self._last_return = self._travelled
        walls = float(np.median(loops[old]))
        loop = Loop(place, True) if place >= walls else Loop(walls, False)
        first_at_place = loop.at_place and not self._closed.at_place and loop.length > self._closed.length
        if not first_at_place and loop.length < self._closed.length + self.LOOP:
            return Loop()
        self._closed = Loop(loop.length, loop.at_place or self._closed.at_place)
        return loop

    def state(self) -> dict[str, Any]:
        """Everything remembered, as plain values."""
        return {
            "seen": self._walls.state(),
            "places": self._places.state(),
            "travelled": self._travelled,
            "last_return": self._last_return,
            "closed": list(self._closed),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._walls.restore(state["seen"])
        self._places.restore(state.get("places", ()))  # checkpoints of older releases have none
        self._travelled, self._last_return = state["travelled"], state["last_return"]
        self._closed = Loop(*state.get("closed", ()))


def _distinct(squares: NDArray[np.int64]) -> tuple[list[Square], NDArray[np.intp]]:
    """The distinct ones of squares (n, 2) and how often each occurs; whole rows take `np.unique` ten times as long."""
    _, first, counts = np.unique(squares[:, 0] * (1 << 32) + squares[:, 1], return_index=True, return_counts=True)
    return [(column, row) for column, row in squares[first].tolist()], counts


class Sightings:
    """When squares of the floor were last seen, by the distance driven."""

    def __init__(self, loop: float) -> None:
        """Nothing was seen. loop: distance driven out of sight that makes the next sight a return [m]."""
        self._loop = loop
        self._seen: dict[Square, tuple[float, float]] = {}  # distance at the last sight, length of its loop [m]

    def see(self, squares: Iterable[Square], travelled: float) -> list[float]:
        """Note that squares are seen; length of the loop by which each was found again [m], 0 = by none."""
        loops = []
        for column, row in squares:
            last, loop = self._seen.get((column, row), (travelled, 0.0))
            gone = travelled - last
            loop = gone if gone >= self._loop else loop
            self._seen[column, row] = travelled, loop
            loops.append(loop)
        return loops

    def state(self) -> list[list[float]]:
        """Everything remembered, as plain values."""
        return [[*square, *values] for square, values in self._seen.items()]

    def restore(self, state: Iterable[list[float]]) -> None:
        """Take over what `state` gave."""
        self._seen = {(int(column), int(row)): (last, loop) for column, row, last, loop in state}
