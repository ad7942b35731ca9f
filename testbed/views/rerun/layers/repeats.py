# SPDX-License-Identifier: MIT
"""What happens again and again is said once in a while, with how often it happened in between."""

from __future__ import annotations

import math
from dataclasses import dataclass

MIN_QUIET_S = 2.0
"""One event takes several scans: after it there is none for this long [s], however large."""


@dataclass
class Repeats:
    """Decides which of many like events are said."""

    quiet: float
    """After an event that was said there is none for this long [s], unless it is more than twice as large."""
    _said_at: float = -math.inf
    _sizes: tuple[float, ...] = ()  # of the event that was said last
    _left_out: int = 0

    def say(self, time: float, *sizes: float) -> str | None:
        """What to add to the line of an event: how many like it were left out since the last one; None = say nothing.

        time: of the event [s];  sizes: in any units, always the same ones
        """
        larger = any(size > 2.0 * before for size, before in zip(sizes, self._sizes, strict=False))
        since = abs(time - self._said_at)
        if since < MIN_QUIET_S or (since < self.quiet and not larger):
            self._left_out += 1
            return None
        left_out = f" ({self._left_out} more since {self._said_at:.0f} s)" if self._left_out else ""
        self._said_at, self._sizes, self._left_out = time, sizes, 0
        return left_out
