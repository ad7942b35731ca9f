# SPDX-License-Identifier: MIT
"""Detects when a robot comes back to an area that it left long ago: the moment at which a loop closes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose

Square = int
"""Column and row in one number, see `_square_at`, which a dictionary finds faster than a pair."""
ROWS = 1 << 32
"""Squares of a column."""


class Loop(NamedTuple):
    """What a scan says of loops."""

    length: float = 0.0
    """Length of the loop that the scan closes [m]: driven since the walls that it sees, or the place where the robot
    is, were last seen before it came back; 0 = it closes none."""
    at_place: bool = False
    """Whether the robot is back at a place where it was; else it sees walls again that it saw from there."""
    scans_ago: int = 0
    """How many scans ago that was, of those that were taken in."""


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
    PLACE = 0.4
    """Side of the squares in which places are remembered [m] …"""
    REACH = 0.8
    """… the robot is at those whose middles are within this distance of it [m]: two poses at one place are at most
    1.1 m apart."""
    AROUND = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if i or j]  # noqa: RUF012
    """Columns and rows of the squares that can be that near, seen from the square of the robot."""

    def __init__(self) -> None:
        self._walls, self._places = Sightings(self.LOOP), Sightings(self.LOOP)
        self._travelled = 0.0
        self._scans = 0
        self._last_return = -self.LOOP
        self._closed = (0.0, False)  # longest gap of the return that goes on [m], and whether a place was reached

    def update(self, hits: NDArray[np.float64], pose: Pose, distance: float) -> Loop:
        """Take in a scan and find the loop that it closes.

        hits (n, 2) end points in the map's frame [m];  pose (3,) of the robot there
        distance: that the robot has moved since the scan before [m]
        A loop closes with the first scan that sees enough old walls, and again, once, when the robot is back at a place
        and has driven further since it was there, or when the loop has become `LOOP` metres longer. The next one closes
        after the robot has driven `LOOP` metres without old walls.
        """
        self._travelled += distance
        self._scans += 1
        squares = np.floor(hits / self.SQUARE).astype(np.int64)
        beams = Counter((squares[:, 0] * ROWS + squares[:, 1]).tolist())
        seen = sorted(beams)
        walls_seen = self._walls.see(seen, self._travelled, self._scans)
        places = self._places.see(self._squares_around(pose), self._travelled, self._scans)
        old = [(sight, beams[square]) for square, sight in zip(seen, walls_seen, strict=True) if sight[2] > 0.0]
        if not old or sum(count for _, count in old) < self.SHARE * len(hits):
            return Loop()
        if self._travelled - self._last_return >= self.LOOP:
            self._closed = 0.0, False
        self._last_return = self._travelled
        by_gap = sorted((sight for sight, _ in old), key=lambda sight: sight[2])
        walls, place = Sight(*by_gap[len(old) // 2]), Sight(*places[0])
        at_place = place.gap >= walls.gap
        sight = place if at_place else walls
        gap, was_at_place = self._closed
        first_at_place = at_place and not was_at_place and sight.gap > gap
        if not first_at_place and sight.gap < gap + self.LOOP:
            return Loop()
        self._closed = sight.gap, at_place or was_at_place
        return Loop(self._travelled - sight.distance_before, at_place, self._scans - sight.scan_before)

    def _squares_around(self, pose: Pose) -> list[Square]:
        """The squares of places that the robot is at, that of its pose (3,) first."""
        x, y = pose[0] / self.PLACE, pose[1] / self.PLACE
        column, row, reach2 = math.floor(x), math.floor(y), (self.REACH / self.PLACE) ** 2
        right, up = column + 0.5 - x, row + 0.5 - y  # from the robot to the middle of its square
        middle = _square_at(column, row)
        near = [middle + _square_at(i, j) for i, j in self.AROUND if (right + i) ** 2 + (up + j) ** 2 <= reach2]
        return [middle, *near]

    def state(self) -> dict[str, Any]:
        """Everything remembered, as plain values."""
        return {
            "seen": self._walls.state(),
            "places": self._places.state(),
            "travelled": self._travelled,
            "scans": self._scans,
            "last_return": self._last_return,
            "closed": list(self._closed),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._walls.restore(state["seen"])
        self._places.restore(state["places"])
        self._travelled, self._last_return = state["travelled"], state["last_return"]
        self._scans = state["scans"]
        gap, at_place = state["closed"]
        self._closed = gap, at_place


def _square_at(column: int, row: int) -> Square:
    """The square in a column and a row."""
    return column * ROWS + row


def _column_and_row(square: Square) -> tuple[int, int]:
    """What `_square_at` made one number of."""
    column = (square + ROWS // 2) // ROWS
    return column, square - column * ROWS


class Sight(NamedTuple):
    """When a square was seen."""

    distance: float
    """Distance driven at the last sight [m]."""
    scan: int
    """Scan of the last sight."""
    gap: float = 0.0
    """Distance driven out of sight before it was found again [m]; 0 = it was not."""
    distance_before: float = 0.0
    """Distance driven at the last sight before that [m]."""
    scan_before: int = 0
    """Scan of the last sight before that."""


SightValues = tuple[float, int, float, float, int]
"""The values of a `Sight`."""


class Sightings:
    """When squares of the floor were last seen, by the distance driven and by the number of the scan."""

    def __init__(self, loop: float) -> None:
        """Nothing was seen. loop: distance driven out of sight that makes the next sight a return [m]."""
        self._loop = loop
        self._seen: dict[Square, SightValues] = {}

    def see(self, squares: Iterable[Square], travelled: float, scan: int) -> list[SightValues]:
        """Note that squares are seen by a scan, and return what is known of each: the values of a `Sight`.

        Plain tuples are made faster than named ones, and Python's search for garbage passes over them.
        """
        sights, seen, loop = [], self._seen, self._loop
        new = travelled, scan, 0.0, 0.0, 0
        for square in squares:
            last, last_scan, gap, before, scan_before = seen.get(square, new)
            if travelled - last >= loop:
                gap, before, scan_before = travelled - last, last, last_scan
            sight = seen[square] = (travelled, scan, gap, before, scan_before)
            sights.append(sight)
        return sights

    def state(self) -> list[list[float]]:
        """Everything remembered, as plain values."""
        return [[*_column_and_row(square), *sight] for square, sight in self._seen.items()]

    def restore(self, state: Iterable[list[float]]) -> None:
        """Take over what `state` gave."""
        self._seen = {
            _square_at(int(column), int(row)): (distance, int(scan), gap, distance_before, int(scan_before))
            for column, row, distance, scan, gap, distance_before, scan_before in state
        }
