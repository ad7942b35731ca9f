# SPDX-License-Identifier: MIT
"""Stamps of recordings: seconds, or nanoseconds where the first one can be nothing else."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MAX_SECONDS = 1e10
"""Largest sensible stamp [s]: the year 2286. What lies beyond is another unit, or damaged."""
MIN_NANOSECONDS = 1e16
"""Smallest stamp that is taken for nanoseconds since 1970: April of that year."""
NANOSECONDS_NOTE = "stamps are in nanoseconds; they are read as seconds"
EXPECTED = "expected seconds, or nanoseconds in all stamps"


class StampUnit:
    """The unit of a recording's stamps, found at its first one."""

    def __init__(self) -> None:
        self._seconds: float | None = None

    @property
    def is_nanoseconds(self) -> bool:
        """Whether the first stamp was one in nanoseconds."""
        return self._seconds is not None and self._seconds < 1.0

    def seconds(self, stamp: float) -> float:
        """The stamp in seconds; ValueError where it cannot be one of this recording."""
        if self._seconds is None:
            self._seconds = 1e-9 if abs(stamp) >= MIN_NANOSECONDS else 1.0
        in_seconds = stamp * self._seconds
        if abs(in_seconds) > MAX_SECONDS:
            raise ValueError(f"a stamp of {stamp:.10g}, {EXPECTED}")
        return in_seconds


def column_in_seconds(stamps: NDArray[np.float64], first: float) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Finite stamps (n,) in seconds, by the unit of the first stamp of the recording, and which cannot be, (n,)."""
    in_seconds = stamps * (1e-9 if abs(first) >= MIN_NANOSECONDS else 1.0)
    return in_seconds, np.abs(in_seconds) > MAX_SECONDS
