# SPDX-License-Identifier: MIT
"""Recent poses at a constant rate, readable at any time between them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

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

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """Poses at `times` (...) [s], (..., 3), linear between the two neighbours.

        Raises `ValueError` for times that are not kept.
        """
        wanted = np.asarray(times, dtype=np.float64)
        position = wanted / self._period - self._first_index
        if np.any(position < -1e-6) or np.any(position > len(self._poses) - 1 + 1e-6):
            raise ValueError(f"times up to {np.max(wanted)} s are not all among those kept, up to {self.end} s")
        index = np.clip(np.floor(position).astype(np.intp), 0, max(len(self._poses) - 2, 0))
        weight = np.clip(position - index, 0.0, 1.0)[..., None]
        after = np.minimum(index + 1, len(self._poses) - 1)
        poses: NDArray[np.float64] = (1.0 - weight) * self._poses[index] + weight * self._poses[after]
        return poses

    def forget_before(self, time: float) -> None:
        """Drop poses older than `time` [s], but keep one at or before it."""
        drop = min(max(int(time / self._period) - self._first_index, 0), len(self._poses) - 1)
        self._poses = self._poses[drop:]
        self._first_index += drop
