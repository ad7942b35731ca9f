# SPDX-License-Identifier: MIT
"""How often what is logged, in the run's own time: bounds the size of a recording and the memory of its viewer."""

from __future__ import annotations

import math
from dataclasses import dataclass

FRAME_PERIOD = 0.1
"""Least time between two poses with their scans and errors, unless the filter took the scan in [s]."""
MAP_PERIOD = 1.0
"""Time between two maps [s]."""
MAP_BYTES_PER_SECOND = 250_000
"""A viewer keeps maps uncompressed: larger ones come less often, so that an hour fits into its memory limit of 1 GB."""
COMPARISON_PERIOD = 15
"""Maps of four particles come with every so many periods of the map."""
SLACK = 0.9
"""Scans do not come to the millisecond: a period counts as over a little early."""


@dataclass
class Schedule:
    """Remembers when things were last logged. Stamps [s] may jump back, as they do in recorded logs."""

    _frame: float = -math.inf
    _map: float = -math.inf
    _comparison: float = -math.inf
    _map_period: float = MAP_PERIOD

    def frame_due(self, stamp: float, updated: bool) -> bool:
        """Whether pose, scan and errors are to be logged, now that a scan has come."""
        if not updated and abs(stamp - self._frame) < SLACK * FRAME_PERIOD:
            return False
        self._frame = stamp
        return True

    def map_due(self, stamp: float, resampled: bool) -> bool:
        """Whether the map is to be logged: once in a period, after resampling already in the half of it."""
        period = 0.5 * self._map_period if resampled else self._map_period
        return abs(stamp - self._map) >= SLACK * period

    def map_was_logged(self, stamp: float, cells: int) -> None:
        """Note the map's size, one byte a cell."""
        self._map = stamp
        self._map_period = max(MAP_PERIOD, cells / MAP_BYTES_PER_SECOND)

    def comparison_due(self, stamp: float) -> bool:
        """Whether the maps of several particles are to be logged with this one."""
        if abs(stamp - self._comparison) < SLACK * COMPARISON_PERIOD * self._map_period:
            return False
        self._comparison = stamp
        return True
