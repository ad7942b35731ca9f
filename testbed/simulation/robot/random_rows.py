# SPDX-License-Identifier: MIT
"""Random numbers for one or many robots, drawn many rows at a time from each robot's own generator.

A call of numpy's generators costs as much as some hundred numbers, and a robot needs a few at every reading.
"""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray


class RandomRows:
    """Endless rows of uniform numbers in [0, 1) and of standard normal numbers for each robot.

    The numbers of a robot depend on its own generator only.
    """

    def __init__(self, robots: int, uniforms: int, normals: int, *, rows: int = 16) -> None:
        """uniforms, normals: numbers in a row; rows: number of rows that are drawn at once, which decides the bits"""
        self.uniform: NDArray[np.float64] = np.empty((robots, rows, uniforms))
        """Uniform numbers drawn in advance, (robots, rows, uniforms)."""
        self.normal: NDArray[np.float64] = np.empty((robots, rows, normals))
        """Normal numbers drawn in advance, (robots, rows, normals)."""
        self.row = np.zeros(robots, np.int64)
        """Index of the current row of each robot, (robots,)."""
        self._rows = rows
        self._generators: list[Generator | None] = [None] * robots

    def seed(self, robot: int, rng: Generator) -> None:
        """Restart the sequence of one robot; the next step leads to its first row."""
        self._generators[robot] = rng
        self.row[robot] = self._rows - 1

    def advance(self, robots: NDArray[np.intp]) -> None:
        """Advance these robots (indices) to their next rows; all of them were seeded."""
        self.row[robots] += 1
        for robot in np.flatnonzero(self.row == self._rows).tolist():
            self._refill(robot)

    def next_of(self, robot: int, most: int = 1) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the next rows of one robot, at least one and at most `most`, as many as are drawn already.

        They are uniform (n, uniforms) and normal (n, normals) numbers, valid until the next call.
        """
        row = int(self.row[robot]) + 1
        if row == self._rows:
            self._refill(robot)
            row = 0
        end = min(row + most, self._rows)
        self.row[robot] = end - 1
        return self.uniform[robot, row:end], self.normal[robot, row:end]

    def _refill(self, robot: int) -> None:
        generator = self._generators[robot]
        assert generator is not None
        generator.random(out=self.uniform[robot])
        generator.standard_normal(out=self.normal[robot])
        self.row[robot] = 0
