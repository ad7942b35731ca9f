# SPDX-License-Identifier: MIT
"""The histories of all particles as one tree: who shares whose past, and who died at a resampling.

It is kept from what the filter shows of itself at each update: the poses of the particles before they are resampled
and after. Between two resamplings particle i stays particle i.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose

MAX_POINTS = 1000
"""The tree is drawn with about this many points: of long branches every k-th pose."""


@dataclass(eq=False)
class _Epoch:
    """The time between two resamplings."""

    poses: list[NDArray[np.float64]] = field(default_factory=list)
    """Positions (particles, 2) at each update, before a resampling at the last one."""
    parents: NDArray[np.intp] | None = None
    """Which particle of the epoch before each one continues, (particles,); None = the first epoch."""


class ParticleTree:
    """All that is alive of the particles' histories."""

    def __init__(self) -> None:
        """Start without an update."""
        self._start()

    def _start(self) -> None:
        """Forget all histories: the first update, or a filter that starts again, for example after it was lost."""
        self._trunk: list[NDArray[np.float64]] = []  # positions (n, 2) of the past that all particles share
        self._epochs = [_Epoch()]

    def add(self, proposed: Pose, poses: Pose, *, resampled: bool = True) -> NDArray[np.float64] | None:
        """Take in one update.

        proposed (n, 3): poses of the particles before resampling;  poses (m, 3): after it, copies of them;  resampled:
        whether they may have been; else both are the same

        Returns, where they were resampled, the branches (dead, updates, 2) of the particles that died, as far back as
        the resampling before; None where they were not.
        """
        if len(proposed) != self._expected(len(proposed)):
            self._start()
        epoch = self._epochs[-1]
        epoch.poses.append(proposed[:, :2].copy())
        if not resampled or (len(proposed) == len(poses) and (proposed == poses).all()):
            return None
        parents = _parents(proposed, poses)
        if parents is None:  # the particles are elsewhere now
            self._start()
            self._epochs[-1].poses.append(poses[:, :2].copy())
            return None
        dead = np.setdiff1d(np.arange(len(proposed)), parents)
        branches: NDArray[np.float64] = np.stack(epoch.poses, axis=1)[dead]
        self._epochs.append(_Epoch(parents=parents))
        self._merge()
        return branches

    def _expected(self, unknown: int) -> int:
        """Number of particles that the next update continues; `unknown` before the first update."""
        last = self._epochs[-1]
        if last.poses:
            return len(last.poses[-1])
        return unknown if last.parents is None else len(last.parents)

    def _merge(self) -> None:
        """Move epochs that only one particle survived to the trunk."""
        alive = self._alive()
        while len(self._epochs) > 1 and len(alive[0]) == 1:
            oldest = self._epochs.pop(0)
            self._trunk.append(np.stack(oldest.poses)[:, alive.pop(0)[0]])
            self._epochs[0].parents = None

    def _alive(self) -> list[NDArray[np.intp]]:
        """Which particles of each epoch have living descendants."""
        last = self._epochs[-1]
        count = len(last.poses[-1]) if last.poses else len(last.parents) if last.parents is not None else 0
        alive = [np.arange(count)]
        for epoch in self._epochs[:0:-1]:
            assert epoch.parents is not None
            alive.insert(0, np.unique(epoch.parents[alive[0]]))
        return alive

    def strips(self) -> list[NDArray[np.float64]]:
        """The tree as lines (n, 2), each branch once; branches begin where they leave the tree."""
        trunk = np.concatenate(self._trunk) if self._trunk else np.zeros((0, 2))
        alive = self._alive()
        count = sum(len(epoch.poses) * len(living) for epoch, living in zip(self._epochs, alive, strict=True))
        step = max(1, -(-count // MAX_POINTS))
        strips = [trunk[:: max(1, -(-len(trunk) // MAX_POINTS))]] if len(trunk) else []
        ends = trunk[-1:]  # where the branches of the next epoch begin, (particles, 2)
        for epoch, living in zip(self._epochs, alive, strict=True):
            if not epoch.poses:
                continue
            kept = np.unique(np.r_[np.arange(0, len(epoch.poses), step), len(epoch.poses) - 1])
            lines = np.stack([epoch.poses[k] for k in kept])
            if len(ends):
                start = ends[epoch.parents] if epoch.parents is not None else np.repeat(ends, lines.shape[1], axis=0)
                lines = np.concatenate([start[None], lines])
            strips += list(lines[:, living].swapaxes(0, 1))
            ends = epoch.poses[-1]
        return [strip for strip in strips if len(strip) > 1]


def _parents(proposed: Pose, poses: Pose) -> NDArray[np.intp] | None:
    """Which of `proposed` (n, 3) each of `poses` (m, 3) is a copy of, (m,); None where one is a copy of none."""
    same = (poses[:, None] == proposed[None]).all(axis=2)
    return np.argmax(same, axis=1) if same.any(axis=1).all() else None
