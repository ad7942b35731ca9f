# SPDX-License-Identifier: MIT
"""Evenly spaced beams: what most formats can hold of a scan's angles and times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TOLERANCE = 1e-6
"""Deviation from even spacing that counts as rounding, radians or seconds."""


def even_spacing(values: NDArray[np.float64]) -> tuple[float, float] | None:
    """First value and step of evenly spaced values (n,); None where they are not even. No values: 0 and 0."""
    if values.size == 0:
        return 0.0, 0.0
    start = float(values[0])
    step = float(values[-1] - start) / max(values.size - 1, 1)
    even = np.allclose(values, start + step * np.arange(values.size), rtol=0.0, atol=TOLERANCE)
    return (start, step) if even else None
