# SPDX-License-Identifier: MIT
"""Most formats hold a lidar with evenly spaced beam angles and beam times, and one mount."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam import se2

TOLERANCE = 1e-6
"""Deviation from even spacing that counts as rounding, radians or seconds."""


SAME_MOUNT = 1e-5
"""Mounts that differ by less [m], [rad] are the same: logs round their poses."""


def same_mount(a: tuple[float, float, float], b: tuple[float, float, float]) -> bool:
    """Tell whether two poses `T_robot_lidar` of a lidar are equal up to rounding."""
    return bool(np.abs(se2.between(np.array(a), np.array(b))).max() <= SAME_MOUNT)


def even_spacing(values: NDArray[np.float64]) -> tuple[float, float] | None:
    """First value and step of evenly spaced values (n,); None where they are not even. No values: 0 and 0."""
    if values.size == 0:
        return 0.0, 0.0
    start = float(values[0])
    step = float(values[-1] - start) / max(values.size - 1, 1)
    even = np.allclose(values, start + step * np.arange(values.size), rtol=0.0, atol=TOLERANCE)
    return (start, step) if even else None
