# SPDX-License-Identifier: MIT
"""The estimate of a whole recording: path, map, and what is known of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.trajectory import Trajectory
from slam.loops import LoopClosing
from slam.occupancy import OccupancyGrid


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """The estimate of a whole recording; poses are `T_map_robot`."""

    dense: Trajectory
    """Poses at every frame, in the order of the recording."""
    scan_frames: NDArray[np.intp]
    """Indices of the frames with a scan, (scans,)."""
    map: OccupancyGrid
    """The map that belongs to the poses."""
    closing: LoopClosing | None = None
    """The loops that the final pass found; None where none were looked for."""
    noise: dict[str, float] | None = None
    """What the final pass found the noise to be, the group `noise` of `metrics.json`; None without a final pass."""
    covariances: NDArray[np.float64] | None = None
    """Covariances of the dense poses relative to the first, (frames, 3, 3); None without a final pass."""
    notes: tuple[str, ...] = ()
    """What a reader of the result must know."""

    @property
    def at_scans(self) -> Trajectory:
        """Poses at every scan."""
        return self.dense[self.scan_frames]
