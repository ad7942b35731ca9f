# SPDX-License-Identifier: MIT
"""The scans as the final pass sees them: each from the frame nearest to the middle of its sweep.

The beams of a sweep are moved to one moment with the velocity that the odometry reports. An error d of that turn rate
turns the whole scan by d times the mean time between its beams and that moment. About the beginning of the sweep, to
which its stamp belongs, that is half a sweep: more than the ranges leave open where encoders are coarse. About the
middle it is nothing, and the pose at the stamp follows from the odometry on both sides of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config import FilterConfig
from slam.refinement.bent_scans import Sweeps, between_neighbours, misplaced_scans, path_twists
from slam.scan import Scan
from slam.sensor.possible_motion import possible_twist
from slam.sensor.rays import Rays, make_rays

KEPT_BEAMS = 2_000_000
"""Rays of so many beams are kept in memory, 66 MB; those of later scans are made anew whenever they are asked for."""


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


class ScanLayout(Mapping[int, Rays]):
    """The rays of scans by the frame that each is seen from, in the order of the frames.

    They are made when they are asked for, and kept as far as `KEPT_BEAMS` allows: the rays of an hour take many times
    the memory of the readings that they are made of.
    """

    def __init__(
        self,
        scans: Sequence[Scan | None],
        stamps: NDArray[np.float64] | None,
        twists: Sequence[NDArray[np.float64] | None] | None,
        config: FilterConfig,
    ) -> None:
        """stamps (frames,): increasing times [s], or None;  twists: (3,) or None of each frame, or None."""
        self._stamps, self._config, self._scans = stamps, config, scans
        taken = [i for i, scan in enumerate(scans) if scan is not None]
        self._twists = dict.fromkeys(taken) if twists is None else {i: twists[i] for i in taken}
        seen_from = {i: i for i in taken} if stamps is None else middle_frames(stamps, scans)
        self._taken = dict(sorted((frame, i) for i, frame in seen_from.items()))
        self._made: dict[int, Rays] = {}
        self._to_keep = self._first_of(KEPT_BEAMS)

    def __iter__(self) -> Iterator[int]:
        return iter(self._taken)

    def __len__(self) -> int:
        return len(self._taken)

    def __getitem__(self, frame: int) -> Rays:
        if frame in self._made:
            return self._made[frame]
        rays = self._lay_out(frame)
        if frame in self._to_keep:
            self._made[frame] = rays
        return rays

    def with_hits(self) -> ScanLayout:
        """Return the scans that have a hit; what is straightened later is so in both."""
        part = copy(self)
        part._taken = {frame: i for frame, i in self._taken.items() if self[frame].hit.any()}
        return part

    def straighten(self, poses: se2.Pose) -> se2.Pose | None:
        """Lay out by the path the scans that were bent by a motion that is not that of poses (frames, 3).

        Returns poses (frames, 3) from which to go on; None where none was bent or misplaced.
        """
        sweeps = self._sweeps()
        if self._stamps is None or sweeps is None:
            return None
        twists = path_twists(sweeps, poses, self._stamps)
        bent = np.array(list(twists), np.int64)
        moved = np.union1d(bent, misplaced_scans(sweeps, bent, poses, self._stamps))
        if not moved.size:
            return None
        for k, twist in twists.items():
            self._twists[int(sweeps.taken[k])] = twist
            self._made.pop(int(sweeps.frames[k]), None)
        return between_neighbours(sweeps.frames, moved, poses)

    def _first_of(self, beams: int) -> set[int]:
        """Return the first frames whose scans have so many beams together."""
        counts = np.cumsum([len(self._scan(i).ranges) for i in self._taken.values()])
        return set(list(self._taken)[: int(np.searchsorted(counts, beams, side="right"))])

    def _scan(self, i: int) -> Scan:
        scan = self._scans[i]
        assert scan is not None
        return scan

    def _lay_out(self, frame: int) -> Rays:
        i = self._taken[frame]
        return make_rays(
            [self._scan(i)],
            usable_range=self._config.map.usable_range,
            free_range=self._config.map.free_range,
            twist=self._twists[i],
            reference=None if self._stamps is None else float(self._stamps[frame]),
        )

    def _sweeps(self) -> Sweeps | None:
        """The scans whose beams have times and whose motion the odometry tells; None where there are none."""
        timed = []
        for frame, i in self._taken.items():
            offsets, twist = self._scan(i).time_offsets, self._twists[i]
            if offsets is not None and offsets.size and twist is not None:
                used = possible_twist(twist)
                timed.append((i, frame, float(np.ptp(offsets)), np.zeros(3) if used is None else used))
        if not timed:
            return None
        taken, frames, seconds, twists = zip(*timed, strict=True)
        return Sweeps(np.array(taken), np.array(frames), np.array(seconds), np.array(twists, dtype=np.float64))
