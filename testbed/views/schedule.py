# SPDX-License-Identifier: MIT
"""How often what is logged: bounds the size of a recording, the memory of its viewer, and the time that it takes.

Periods are in the run's own time. Maps are the dear part: they are further bound to a share of the wall time, for runs
that are many times faster than the robot was, such as those of logs with a scan every few seconds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

FRAME_PERIOD = 0.1
"""Least time between two poses with their scans and errors, unless the filter took the scan in [s]."""
MAP_PERIOD = 1.0
"""Time between two maps [s]."""
MAP_BYTES_PER_SECOND = 250_000
"""A viewer keeps maps uncompressed: larger ones come less often, so that an hour fits into its memory limit of 1 GB."""
MAP_SHARE = 0.03
"""Share of the wall time that maps may take."""
MAPS_PER_COMPARISON = 15
"""The maps of four particles come with every so many maps."""
SLACK = 0.9
"""Scans do not come to the millisecond: a period counts as over a little early."""


@dataclass
class Schedule:
    """Remembers when things were last logged. Stamps [s] may jump back, as they do in recorded logs."""

    clock: Callable[[], float] = time.monotonic
    """Wall time [s]."""
    _frame: float = -math.inf
    _map: float = -math.inf
    _maps: int = 0
    _map_period: float = MAP_PERIOD
    _map_allowed: float = -math.inf

    def frame_due(self, stamp: float, updated: bool) -> bool:
        """Whether pose, scan and errors are to be logged, now that a scan has come."""
        if not updated and abs(stamp - self._frame) < SLACK * FRAME_PERIOD:
            return False
        self._frame = stamp
        return True

    def map_due(self, stamp: float, resampled: bool) -> bool:
        """Whether the map is to be logged: once in a period, after resampling already in the half of it."""
        period = 0.5 * self._map_period if resampled else self._map_period
        return abs(stamp - self._map) >= SLACK * period and self.clock() >= self._map_allowed

    def map_was_logged(self, stamp: float, cells: int, seconds: float) -> None:
        """Note the map's size, one byte a cell, and the wall time that it took [s]."""
        self._map = stamp
        self._maps += 1
        self._map_period = max(MAP_PERIOD, cells / MAP_BYTES_PER_SECOND)
        self._map_allowed = self.clock() + seconds / MAP_SHARE

    @property
    def comparison_due(self) -> bool:
        """Whether the maps of several particles are to be logged with this one."""
        return self._maps % MAPS_PER_COMPARISON == 0
