# SPDX-License-Identifier: MIT
"""The path of the best particle in blocks of which only those that have changed are sent again.

Its past changes when the particles are resampled or another one becomes the best, but only back to where the two
histories parted: a run of an hour would otherwise send megabytes of path each second.
"""

from __future__ import annotations

import numpy as np

from slam.se2 import Pose

BLOCK = 200
"""Poses of a block; each block also begins with the last pose of the one before it."""


class PathBlocks:
    """What was last sent of one path."""

    def __init__(self) -> None:
        """Nothing was sent yet."""
        self._sent = np.zeros((0, 3))

    def changes(self, path: Pose) -> list[tuple[int, Pose]]:
        """Number and poses (n, 3) of the blocks that have changed; empty ones are gone. path (updates, 3)"""
        common = min(len(path), len(self._sent))
        different = np.flatnonzero((path[:common] != self._sent[:common]).any(axis=1))
        first = int(different[0]) if len(different) else common
        shrinks = len(path) < len(self._sent)
        longest = len(self._sent) + 1 if shrinks else len(path)  # the last pose sent may be alone in its block
        self._sent = path.copy()
        return [(number, path[number * BLOCK : (number + 1) * BLOCK + 1]) for number in _blocks(first, longest)]


class GrowingPath:
    """A path that never changes but at its end."""

    def __init__(self) -> None:
        """No pose has come yet."""
        self._poses: list[Pose] = []
        self._sent = 0

    def append(self, pose: Pose) -> None:
        """Add a pose (3,)."""
        self._poses.append(pose)

    @property
    def poses(self) -> Pose:
        """All poses, (n, 3)."""
        return np.array(self._poses).reshape(-1, 3)

    def changes(self) -> list[tuple[int, Pose]]:
        """Number and poses (n, 3) of the blocks that have changed since the last call."""
        first, self._sent = self._sent, len(self._poses)
        return [
            (number, np.array(self._poses[number * BLOCK : (number + 1) * BLOCK + 1]))
            for number in _blocks(first, self._sent)
        ]


def _blocks(first: int, end: int) -> range:
    """Numbers of the blocks that hold the poses from `first` to before `end`."""
    if first == end:
        return range(0)
    return range(max(first - 1, 0) // BLOCK, max(end - 2, 0) // BLOCK + 1)  # a pose may end one and begin the next
