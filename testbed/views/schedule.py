# SPDX-License-Identifier: MIT
"""How often things are logged, in the run's own time, so that a recording is the same however fast the run was."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FRAME_PERIOD = 0.1
"""Least time between two poses with their scans and errors, unless the filter took the scan in [s]."""
MAP_PERIOD = 1.0
"""The map that is shown is never older than this [s] …"""
MAP_DISTANCE = 0.5
"""… nor from further back than this along the path [m] …"""
MAP_GROWTH = 0.05
"""… nor by more than this part of the run so far: a young map grows fast."""
COMPARISON_PERIOD = 10.0
"""Time between two comparisons of particles [s] …"""
COMPARISON_UPDATES, COMPARISON_SPARSE_UPDATES = 30, 200
"""… in which the filter has taken in at least so many scans; the second number holds for logs with less than a scan a
second: they are processed so fast that comparing costs a noticeable part of the run."""
SLACK = 0.9
"""Scans do not come at exact times: a period counts as over a little early."""
MAX_MOMENTS = 1500
"""Scans at which robots are drawn where several systems are compared, evenly spread."""


@dataclass
class Schedule:
    """Remembers when things were last logged. Stamps [s] may jump back, as they do in recorded logs."""

    _frame: float = -math.inf
    _start: float = 0.0
    _map: float = -math.inf
    _map_at: float = -math.inf
    _comparison: float = -math.inf
    _updates: int = COMPARISON_UPDATES

    def frame_due(self, stamp: float, updated: bool) -> bool:
        """Whether pose, scan and errors are to be logged, now that a scan has come."""
        if not updated and abs(stamp - self._frame) < SLACK * FRAME_PERIOD:
            return False
        self._frame = stamp
        return True

    def map_due(self, stamp: float, travelled: float, next_step: tuple[float, float]) -> bool:
        """Whether the map that is shown would become too old before the next scan.

        travelled: distance driven so far [m];  next_step: time [s] and distance [m] to the next scan, about
        """
        seconds, metres = next_step
        period = min(MAP_PERIOD, MAP_GROWTH * abs(stamp - self._start))
        age, way = abs(stamp - self._map), travelled - self._map_at
        return age + SLACK * seconds > period or way + SLACK * metres > MAP_DISTANCE

    def map_was_logged(self, stamp: float, travelled: float) -> None:
        """Note that the map was logged."""
        if math.isinf(self._map):
            self._start = stamp
        self._map, self._map_at = stamp, travelled

    def comparison_due(self, stamp: float, at_once: bool, jumped: bool = False) -> bool:
        """Whether particles are to be compared, at an update: at resamplings and returns to old walls (`at_once`), and
        now and then; where the estimate has jumped to another best particle, unless scans are sparse."""
        self._updates += 1
        elapsed = abs(stamp - self._comparison)
        sparse = not math.isinf(elapsed) and elapsed > self._updates
        needed = COMPARISON_SPARSE_UPDATES if sparse else COMPARISON_UPDATES
        late = elapsed >= SLACK * COMPARISON_PERIOD and self._updates >= needed
        if not at_once and not late and not (jumped and not sparse):
            return False
        self._comparison, self._updates = stamp, 0
        return True


def shown_scans(count: int) -> NDArray[np.intp]:
    """Numbers of the scans, of so many, at which the systems of a comparison are drawn: the first, the last, and
    evenly in between, increasing."""
    shown: NDArray[np.intp] = np.unique(np.linspace(0, count - 1, min(count, MAX_MOMENTS)).round().astype(np.intp))
    return shown
