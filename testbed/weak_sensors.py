# SPDX-License-Identifier: MIT
"""Sensors that see too little to carry a map alone: depth cameras, rings of sonars, lidars of a short reach."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

MIN_VIEW, MIN_BEAMS, MIN_REACH = math.radians(90.0), 30, 2.0
"""A lidar that sees less of the circle [rad], has fewer beams or a shorter reach [m] can hardly carry a map."""


def view_of(angles: NDArray[np.float64]) -> float:
    """How much of the circle beams in these directions (n,) see [rad]: each half a step to both sides."""
    return float(np.ptp(angles)) * angles.size / max(angles.size - 1, 1) if angles.size else 0.0


def shortcomings(view: float, beams: int, reach: float) -> list[str]:
    """Say what a sensor lacks to carry a map; view [rad], reach [m]."""
    return [
        words
        for few, words in (
            (view < MIN_VIEW, f"a view of less than {math.degrees(MIN_VIEW):.0f} deg"),
            (beams < MIN_BEAMS, f"fewer than {MIN_BEAMS} beams"),
            (reach < MIN_REACH, f"a reach of less than {MIN_REACH:g} m"),
        )
        if few
    ]
