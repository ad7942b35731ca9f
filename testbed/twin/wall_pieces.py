# SPDX-License-Identifier: MIT
"""Straight pieces of walls, and the readings that ended on them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from testbed.twin.returns import ComparedScan

Floats = NDArray[np.float64]

MIN_COSINE = 0.5
"""Readings of beams that meet the wall at flatter angles tell more about the lidar's angle than about the wall."""
_NEIGHBOURS = 3


class WallReadings(NamedTuple):
    """The n readings of a scan that ended on a wall."""

    off: Floats
    """By how much each went beyond the wall [m], (n,)."""
    due: Floats
    """Distance of the wall [m], (n,)."""
    directions: Floats
    """Direction of the beam in the world [rad], (n,)."""
    headings: Floats
    """The same as unit vectors, (n, 2)."""
    places: Floats
    """Where it met the wall [m], (n, 2)."""
    pieces: NDArray[np.int64]
    """Number of the piece, (n,)."""
    along: Floats
    """Place on it, from 0 to 1, (n,)."""
    normals: Floats
    """Unit vector across it, (n, 2)."""
    cosines: Floats
    """Of the angle between beam and normal, (n,)."""


class WallPieces:
    """Pieces of walls, short compared with the distances between walls."""

    def __init__(self, begins: Floats, ends: Floats) -> None:
        """begins, ends (n, 2) [m]: ends of the pieces"""
        self.begins, self._edges = begins, ends - begins
        lengths = np.maximum(np.hypot(*self._edges.T), 1e-9)
        self.normals = np.column_stack([-self._edges[:, 1], self._edges[:, 0]]) / lengths[:, None]
        self._squares = lengths**2
        self._tree = cKDTree(begins + 0.5 * self._edges)

    def readings_of(self, scan: ComparedScan, most: float) -> WallReadings:
        """Return the readings of a scan that are off a wall by at most so much [m] and did not meet it too flat."""
        with np.errstate(invalid="ignore"):  # inf - inf: nothing was due, and nothing was seen
            on_wall = np.abs(scan.readings - scan.due) <= most
        due, directions = scan.due[on_wall], scan.directions[on_wall]
        headings = np.column_stack([np.cos(directions), np.sin(directions)])
        places = scan.origin + due[:, None] * headings
        pieces, along = self._nearest(places)
        cosines = np.sum(headings * self.normals[pieces], axis=1)
        off, normals = scan.readings[on_wall] - due, self.normals[pieces]
        found = (off, due, directions, headings, places, pieces, along, normals, cosines)
        kept = np.abs(cosines) > MIN_COSINE
        return WallReadings(*(values[kept] for values in found))

    def _nearest(self, points: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return the nearest pieces (n,) of points (n, 2) [m], and the places on them, from 0 to 1, (n,)."""
        count = min(_NEIGHBOURS, len(self.begins))
        near: NDArray[np.int64] = np.asarray(self._tree.query(points, k=np.arange(1, count + 1))[1])
        ahead = points[:, None] - self.begins[near]
        along = np.clip(np.sum(ahead * self._edges[near], axis=2) / self._squares[near], 0.0, 1.0)
        away = np.sum((ahead - along[..., None] * self._edges[near]) ** 2, axis=2)
        rows, best = np.arange(len(points)), np.argmin(away, axis=1)
        return near[rows, best], along[rows, best]
