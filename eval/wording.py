# SPDX-License-Identifier: MIT
"""Format numbers for people."""

from __future__ import annotations

import math


def length(metres: float) -> str:
    """Format a length: 3.2 cm, 45 cm, 1.23 m."""
    if abs(metres) < 0.0995:
        return f"{100.0 * metres:.1f}\N{NO-BREAK SPACE}cm"
    if abs(metres) < 0.995:
        return f"{100.0 * metres:.0f}\N{NO-BREAK SPACE}cm"
    return f"{metres:.2f}\N{NO-BREAK SPACE}m"


def up_to_a_tenth(seconds: float) -> float:
    """Round a time up to a tenth of a second, as it is printed: a viewer that goes to the time shows what was at it."""
    return math.ceil(10.0 * seconds - 1e-6) / 10.0


def at_time(seconds: float) -> str:
    """Format the time of an event since the start of a run, as in the recording's event log: 282.6 s."""
    return f"{up_to_a_tenth(seconds):.1f} s"


def share(value: float) -> str:
    """Format a share: 0 %, 0.4 %, 37 %, 99.6 %, 100 %."""
    percent = 100.0 * value
    digits = 1 if 0.0 < percent < 9.95 or 99.05 < percent < 99.95 else 0
    return f"{percent:.{digits}f}\N{NO-BREAK SPACE}%"


def spread(metres: float, deviation: float) -> str:
    """Format a mean length and its standard deviation: 1.81 ± 1.20 cm, 5.12 ± 8.15 m."""
    factor, unit = (100.0, "cm") if metres < 0.995 else (1.0, "m")
    return f"{factor * metres:.2f} ± {factor * deviation:.2f}\N{NO-BREAK SPACE}{unit}"
