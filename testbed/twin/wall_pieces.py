# SPDX-License-Identifier: MIT
"""Straight pieces of walls, and which of them a beam met."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]

_NEIGHBOURS = 3


class Met(NamedTuple):
    """Where beams met walls, (n,) or (n, 2)."""

    pieces: NDArray[np.int64]
    """Number of the piece."""
    along: Floats
    """Place on it, from 0 to 1."""
    normals: Floats
    """Unit vectors across it."""


class WallPieces:
    """Pieces of walls, short compared with the distances between walls."""

    def __init__(self, begins: Floats, ends: Floats) -> None:
        """begins, ends (n, 2) [m]: ends of the pieces"""
        self.begins, self._edges = begins, ends - begins
        lengths = np.maximum(np.hypot(*self._edges.T), 1e-9)
        self.normals = np.column_stack([-self._edges[:, 1], self._edges[:, 0]]) / lengths[:, None]
        self._squares = lengths**2
        self._tree = cKDTree(begins + 0.5 * self._edges)

    def nearest(self, points: Floats) -> Met:
        """Return where points (n, 2) [m] on the walls lie."""
        count = min(_NEIGHBOURS, len(self.begins))
        near: NDArray[np.int64] = np.asarray(self._tree.query(points, k=np.arange(1, count + 1))[1])
        ahead = points[:, None] - self.begins[near]
        along = np.clip(np.sum(ahead * self._edges[near], axis=2) / self._squares[near], 0.0, 1.0)
        away = np.sum((ahead - along[..., None] * self._edges[near]) ** 2, axis=2)
        rows, best = np.arange(len(points)), np.argmin(away, axis=1)
        pieces = near[rows, best]
        return Met(pieces, along[rows, best], self.normals[pieces])
