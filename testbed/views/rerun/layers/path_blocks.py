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

    @property
    def end(self) -> Pose | None:
        """The last pose that was sent, (3,); None before the first."""
        return self._sent[-1] if len(self._sent) else None

    def changes(self, path: Pose) -> list[tuple[int, Pose]]:
        """Number and poses (n, 3) of the blocks that have changed; empty ones are gone.

        path (updates, 3): kept until the next call, the caller must not change it
        """
        common = min(len(path), len(self._sent))
        different = path[:common] != self._sent[:common]
        first = int(np.argmax(different.any(axis=1))) if different.any() else common
        longest = max(len(path), len(self._sent))
        self._sent = path
        return [(number, _block(path, number)) for number in _blocks(first, longest)]

    def extended(self, poses: Pose) -> list[tuple[int, Pose]]:
        """Number and poses (n, 3) of the blocks that have changed by further poses (k, 3) at the end."""
        first, path = len(self._sent), np.concatenate([self._sent, poses.reshape(-1, 3)])
        self._sent = path
        return [(number, _block(path, number)) for number in _blocks(first, len(path))]


class GrowingPath:
    """A path that never changes but at its end."""

    def __init__(self) -> None:
        """No pose has come yet."""
        self._room = np.empty((BLOCK, 3))  # for the poses, and for those to come
        self._count = 0
        self._sent = 0

    def append(self, pose: Pose) -> None:
        """Add a pose (3,)."""
        if self._count == len(self._room):
            self._room = np.concatenate([self._room, np.empty_like(self._room)])
        self._room[self._count] = pose
        self._count += 1

    @property
    def poses(self) -> Pose:
        """All poses, (n, 3)."""
        return self._room[: self._count]

    def changes(self) -> list[tuple[int, Pose]]:
        """Number and poses (n, 3) of the blocks that have changed since the last call."""
        first, self._sent, poses = self._sent, self._count, self.poses
        return [(number, _block(poses, number)) for number in _blocks(first, self._sent)]


def _block(path: Pose, number: int) -> Pose:
    """The poses (n, 3) of a block; none where it would only repeat the last one of the block before."""
    poses = path[number * BLOCK : (number + 1) * BLOCK + 1]
    return poses if number == 0 or len(poses) > 1 else poses[:0]


def _blocks(first: int, end: int) -> range:
    """Numbers of the blocks that hold the poses from `first` to before `end`."""
    if first == end:
        return range(0)
    return range(max(first - 1, 0) // BLOCK, max(end - 2, 0) // BLOCK + 1)  # a pose may end one and begin the next
