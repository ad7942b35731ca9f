# SPDX-License-Identifier: MIT
"""Recent poses at a constant rate, with interpolation between them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose
from testbed.simulation._history_kernels import interpolate, locate, mean_velocities

_ROOM = 1024
"""First size of the buffer [poses]."""


class History:
    """Poses at times 0, period, 2 period, …; headings are unwrapped, so that they can be interpolated."""

    def __init__(self, first: Pose, period: float) -> None:
        """first: the pose (3,) at time 0; period [s]."""
        self._buffer: NDArray[np.float64] = np.empty((_ROOM, 3))
        self._buffer[0] = first
        self._begin, self._end = 0, 1  # of what is kept, in the buffer
        self._first_index = 0  # of the first kept pose, since time 0
        self._period = period

    @property
    def latest(self) -> Pose:
        """The newest pose, (3,)."""
        newest: Pose = self._buffer[self._end - 1].copy()
        return newest

    @property
    def end(self) -> float:
        """Time of the newest pose [s]."""
        return (self._first_index + self._end - self._begin - 1) * self._period

    def extend(self, poses: NDArray[np.float64]) -> None:
        """Append the next poses, (n, 3), with headings unwrapped among themselves."""
        count = len(poses)
        if self._end + count > len(self._buffer):
            self._make_room(count)
        turns = round((self._buffer[self._end - 1, 2] - poses[0, 2]) / (2.0 * math.pi))
        new = self._buffer[self._end : self._end + count]
        new[:] = poses
        if turns:
            new[:, 2] += 2.0 * math.pi * turns
        self._end += count

    def _make_room(self, count: int) -> None:
        """Move the kept poses to the front of the buffer, or of a larger one if it would be more than half full."""
        kept = self._buffer[self._begin : self._end]
        room = len(self._buffer) if 2 * (len(kept) + count) <= len(self._buffer) else 4 * (len(kept) + count)
        buffer = np.empty((room, 3))
        buffer[: len(kept)] = kept
        self._buffer, self._begin, self._end = buffer, 0, len(kept)

    def at(self, times: NDArray[np.float64], known: NDArray[np.int64]) -> Pose:
        """Return the poses at `times` (n,) [s], (n, 3), interpolated linearly.

        known (n,): number of poses since time 0 that are used for each; later times have the last of them. Raises
        `ValueError` if the poses around them are not kept.
        """
        poses: Pose = interpolate(*self.between(times, known))
        return poses

    def velocities(
        self, begins: NDArray[np.float64], ends: NDArray[np.float64], known: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the mean velocities in the robot's frame from `begins` to `ends` (n,) [s], (n, 3); known (n,): as for
        `at`."""
        velocities: NDArray[np.float64] = mean_velocities(self.at(begins, known), self.at(ends, known), ends - begins)
        return velocities

    def between(
        self, times: NDArray[np.float64], known: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """All poses kept, (n, 3), and where `times` (m,) [s] lie among them, as fractional indices (m,).

        known (m,): as for `at`. The poses are valid until the next `extend`. Raises `ValueError` for times that are not
        kept.
        """
        kept = self._end - self._begin
        positions, are_kept = locate(times, known, self._period, self._first_index, kept)
        if not are_kept:
            raise ValueError(
                f"poses from {times.min()} to {times.max()} s are not all kept, the last is that of {self.end} s"
            )
        return self._buffer[self._begin : self._end], positions

    def forget_before(self, time: float) -> None:
        """Drop poses older than `time` [s], but keep one at or before it."""
        drop = min(max(int(time / self._period) - self._first_index, 0), self._end - self._begin - 1)
        self._begin += drop
        self._first_index += drop
