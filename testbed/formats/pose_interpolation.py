# SPDX-License-Identifier: MIT
"""Poses between the stamps at which they are known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.se2 import Pose

ODOMETRY_REACH = 0.2
"""A scan may lie outside of the odometry's time by this much [s], one period of slow odometry."""


def interpolate(stamps: NDArray[np.float64], poses: Pose, times: NDArray[np.float64]) -> Pose:
    """Poses (m, 3) at `times` (m,) between their neighbours in time, along a constant motion; beyond the ends the
    nearest.

    stamps (n,) increasing [s];  poses (n, 3)
    """
    after = np.searchsorted(stamps, times)
    inside = (after > 0) & (after < len(stamps))
    found: Pose = poses[np.minimum(after, len(stamps) - 1)]
    after, times = after[inside], times[inside]
    share = (times - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
    between = se2.compose(poses[after - 1], share[:, None] * se2.between(poses[after - 1], poses[after]))
    exact = share == 1.0  # where the frame was written with its odometry
    found[inside] = np.where(exact[:, None], poses[after], between)
    return found
