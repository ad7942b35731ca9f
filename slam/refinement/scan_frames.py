# SPDX-License-Identifier: MIT
"""The scans as the final pass sees them: each from the frame nearest to the middle of its sweep.

The beams of a sweep are moved to one moment with the velocity that the odometry reports. An error d of that turn rate
turns the whole scan by d times the mean time between its beams and that moment. About the beginning of the sweep, to
which its stamp belongs, that is half a sweep: more than the ranges leave open where encoders are coarse. About the
middle it is nothing, and the pose at the stamp follows from the odometry on both sides of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config import FilterConfig
from slam.refinement.bent_scans import Sweeps, between_neighbours, path_twists
from slam.scan import Scan
from slam.sensor.rays import Rays, make_rays


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


class Straightened(NamedTuple):
    """Bent scans laid out by the path."""

    rays: dict[int, Rays]
    """By the frame that each is seen from."""
    poses: se2.Pose
    """Poses from which to go on, (frames, 3)."""


class ScanLayout:
    """The rays of all scans, each seen from the frame nearest to the middle of its sweep."""

    def __init__(
        self,
        scans: Sequence[Scan | None],
        stamps: NDArray[np.float64] | None,
        twists: Sequence[NDArray[np.float64] | None] | None,
        config: FilterConfig,
    ) -> None:
        """stamps (frames,): increasing times [s], or None;  twists: (3,) or None of each frame, or None."""
        self._stamps, self._config = stamps, config
        self._scans = {i: scan for i, scan in enumerate(scans) if scan is not None}
        self._twists = dict.fromkeys(self._scans) if twists is None else {i: twists[i] for i in self._scans}
        self._seen_from = {i: i for i in self._scans} if stamps is None else middle_frames(stamps, scans)

    def rays(self) -> dict[int, Rays]:
        """Rays by the frame that their scan is seen from, in the order of the frames."""
        return dict(sorted((self._seen_from[i], self._lay_out(i, self._twists[i])) for i in self._scans))

    def straighten(self, poses: se2.Pose) -> Straightened | None:
        """The scans that were bent by a motion that is not that of poses (frames, 3); None where there are none."""
        sweeps = self._sweeps()
        if self._stamps is None or sweeps is None:
            return None
        twists = path_twists(sweeps, poses, self._stamps)
        if not twists:
            return None
        rays = {int(sweeps.frames[k]): self._lay_out(int(sweeps.taken[k]), twist) for k, twist in twists.items()}
        return Straightened(rays, between_neighbours(sweeps.frames, np.array(list(twists)), poses))

    def _lay_out(self, i: int, twist: NDArray[np.float64] | None) -> Rays:
        return make_rays(
            [self._scans[i]],
            usable_range=self._config.map.usable_range,
            free_range=self._config.map.free_range,
            twist=twist,
            reference=None if self._stamps is None else float(self._stamps[self._seen_from[i]]),
        )

    def _sweeps(self) -> Sweeps | None:
        """The scans whose beams have times and whose motion the odometry tells; None where there are none."""
        timed = [
            (i, self._seen_from[i], float(np.ptp(scan.time_offsets)), twist)
            for i, scan in self._scans.items()
            if scan.time_offsets is not None and scan.time_offsets.size and (twist := self._twists[i]) is not None
        ]
        if not timed:
            return None
        taken, frames, seconds, twists = zip(*timed, strict=True)
        return Sweeps(np.array(taken), np.array(frames), np.array(seconds), np.array(twists, dtype=np.float64))
