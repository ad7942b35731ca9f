# SPDX-License-Identifier: MIT
"""The frame that each scan is seen from in the final pass: the one nearest to the middle of its sweep.

The beams of a sweep are moved to one moment with the velocity that the odometry reports. An error d of that turn rate
turns the whole scan by d times the mean time between its beams and that moment. About the beginning of the sweep, to
which its stamp belongs, that is half a sweep: 0.07 degrees with the default robot and lidar, twice what the ranges
leave open. About the middle it is nothing, and the pose at the stamp follows from the odometry on both sides of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slam.scan import Scan


def middle_frames(stamps: NDArray[np.float64], scans: Sequence[Scan | None]) -> dict[int, int]:
    """The frame from which the scan of each frame that has one is seen.

    stamps (frames,): increasing [s];  scans: one per frame or None. It is the frame without a scan of its own that is
    nearest to the middle of the sweep, where one is nearer than the scan's own; no frame serves two scans.
    """
    free = np.array([scan is None for scan in scans])
    chosen: dict[int, int] = {}
    for i, scan in enumerate(scans):
        if scan is None:
            continue
        chosen[i] = i
        if scan.time_offsets is None or scan.time_offsets.size == 0:
            continue
        middle = stamps[i] + 0.5 * float(scan.time_offsets.min() + scan.time_offsets.max())
        after = int(np.searchsorted(stamps, middle))
        near = [j for j in (after - 1, after) if 0 <= j < len(stamps) and free[j]]
        best = min(near, key=lambda j: abs(float(stamps[j]) - middle), default=i)
        if abs(stamps[best] - middle) < abs(stamps[i] - middle):
            chosen[i], free[best] = best, False
    return chosen
