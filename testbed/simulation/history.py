# SPDX-License-Identifier: MIT
"""Recent poses at a constant rate, readable at any time between them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose


class History:
    """Poses at times 0, period, 2 period, …; headings are unwrapped, so that they can be interpolated."""

    def __init__(self, first: Pose, period: float) -> None:
        """first: the pose (3,) at time 0; period [s]."""
        self._poses: NDArray[np.float64] = np.array(first, dtype=np.float64)[None]
        self._first_index = 0
        self._period = period

    @property
    def latest(self) -> Pose:
        """The newest pose, (3,)."""
        newest: Pose = self._poses[-1]
        return newest

    @property
    def end(self) -> float:
        """Time of the newest pose [s]."""
        return (self._first_index + len(self._poses) - 1) * self._period

    def extend(self, poses: NDArray[np.float64]) -> None:
        """Append the next poses, (n, 3), with headings unwrapped among themselves."""
        turns = round((self._poses[-1, 2] - poses[0, 2]) / (2.0 * math.pi))
        poses = poses + np.array([0.0, 0.0, 2.0 * math.pi * turns])
        self._poses = np.concatenate([self._poses, poses])

    def at(self, time: float) -> Pose:
        """The pose (3,) at `time` [s], linear between its two neighbours. Raises `ValueError` if it is not kept."""
        position = self._position(time, time)
        index = min(int(position), len(self._poses) - 1)
        before, after = self._poses[index], self._poses[min(index + 1, len(self._poses) - 1)]
        pose: Pose = before + (position - index) * (after - before)
        return pose

    def between(self, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """All poses kept, (n, 3), and where increasing `times` (m,) [s] lie among them, as fractional indices (m,).

        Raises `ValueError` for times that are not kept.
        """
        self._position(float(times[0]), float(times[-1]))
        return self._poses, np.maximum(times / self._period - self._first_index, 0.0)

    def _position(self, first: float, last: float) -> float:
        """Fractional index of time `first` [s], once both are known to be kept."""
        position = first / self._period - self._first_index
        end = last / self._period - self._first_index
        if position < -1e-6 or end > len(self._poses) - 1 + 1e-6:
            raise ValueError(f"poses from {first} to {last} s are not all kept, the last is that of {self.end} s")
        return max(position, 0.0)

    def forget_before(self, time: float) -> None:
        """Drop poses older than `time` [s], but keep one at or before it."""
        drop = min(max(int(time / self._period) - self._first_index, 0), len(self._poses) - 1)
        self._poses = self._poses[drop:]
        self._first_index += drop
