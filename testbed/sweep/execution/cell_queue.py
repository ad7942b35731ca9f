# SPDX-License-Identifier: MIT
"""The order in which workers take cells: those of one recording together, so that each drive is simulated once."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Hashable, Sequence

from testbed.sweep.spec.cell import Cell


class CellQueue:
    """Waiting cells, grouped by recording. Workers may take from it at the same time.

    A worker stays with the recording of its last cell. When that has no more cells it takes the first recording that no
    worker has begun, and only when there is none it helps with the one that has the most cells left.
    """

    def __init__(self, cells: Sequence[Cell], recording_key: Callable[[Cell], Hashable]) -> None:
        """cells: in their order of priority, which is kept within a recording and by the first cell of each."""
        self._lock = threading.Lock()
        self._groups: dict[Hashable, deque[Cell]] = {}
        self._begun: set[Hashable] = set()
        for cell in cells:
            self._groups.setdefault(recording_key(cell), deque()).append(cell)

    def take(self, last: Hashable | None) -> tuple[Hashable, Cell] | None:
        """The next cell for a worker with the recording `last`, with the key of its recording; None if none waits."""
        with self._lock:
            key = self._choose(last)
            if key is None:
                return None
            self._begun.add(key)
            cell = self._groups[key].popleft()
            if not self._groups[key]:
                del self._groups[key]
            return key, cell

    def clear(self) -> None:
        """Drop all waiting cells."""
        with self._lock:
            self._groups.clear()

    def _choose(self, last: Hashable | None) -> Hashable | None:
        if last in self._groups:
            return last
        fresh = next((key for key in self._groups if key not in self._begun), None)
        if fresh is not None:
            return fresh
        return max(self._groups, key=lambda key: len(self._groups[key]), default=None)
