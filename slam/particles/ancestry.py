# SPDX-License-Identifier: MIT
"""The trajectories of all particles as one tree: resampling shares histories instead of copying them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.particles._ancestry_kernels import mark_alive, walk_back
from slam.se2 import Pose


class Ancestry:
    """Poses of all generations with a link to each one's parent; branches that died out are dropped.

    Adding a generation costs O(particles) on average, a path O(generations).
    """

    def __init__(self, particles: int) -> None:
        """An empty tree for that many particles."""
        self.generations = 0
        self._leaves: NDArray[np.int64] = np.full(particles, -1)
        self._parents: NDArray[np.int64] = np.empty(4 * particles, np.int64)
        self._poses = np.empty((4 * particles, 3))
        self._used = 0
        self._founders = np.arange(particles)

    def add(self, poses: Pose) -> None:
        """Append one generation: particle i moves on to `poses[i]` (particles, 3)."""
        n = len(self._leaves)
        if self._used + n > len(self._parents):
            self._make_room()
        nodes = np.arange(self._used, self._used + n)
        self._parents[nodes] = self._leaves
        self._poses[nodes] = poses
        self._leaves = nodes
        self._used += n
        self.generations += 1

    def inherit(self, ancestors: NDArray[np.int64]) -> None:
        """Let particle i continue the history of particle `ancestors[i]`; any number of offspring, (offspring,)."""
        if self.coalesced:
            self._founders = np.arange(len(self._leaves))
        self._leaves = self._leaves[ancestors]
        self._founders = self._founders[ancestors]

    @property
    def unique_ancestors(self) -> int:
        """Number of ancestors from which the particles descend; counting starts again once there is a single one."""
        return int(np.count_nonzero(np.bincount(self._founders)))

    @property
    def coalesced(self) -> bool:
        """Whether all particles descend from one founder."""
        return len(self._founders) > 1 and self.unique_ancestors == 1

    def path(self, particle: int) -> Pose:
        """Poses of one particle's history, (generations, 3), oldest first."""
        nodes = np.empty(self.generations, np.int64)
        walk_back(self._parents, self._leaves[particle], nodes)
        path: Pose = self._poses[nodes]
        return path

    def state(self) -> dict[str, NDArray[Any]]:
        """The whole tree, as arrays."""
        return {
            "tree_parents": self._parents[: self._used].copy(),
            "tree_poses": self._poses[: self._used].copy(),
            "tree_leaves": self._leaves.copy(),
            "tree_founders": self._founders.copy(),
            "tree_generations": np.array(self.generations),
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `state` gave."""
        self._parents, self._poses = np.array(state["tree_parents"]), np.array(state["tree_poses"])
        self._leaves, self._founders = np.array(state["tree_leaves"]), np.array(state["tree_founders"])
        self._used, self.generations = len(self._parents), int(state["tree_generations"])

    def _make_room(self) -> None:
        """Drop dead branches, then make room for as many nodes again as are alive."""
        alive = mark_alive(self._parents[: self._used], self._leaves)
        number = np.cumsum(alive) - 1
        kept = int(alive.sum())
        parents = self._parents[: self._used][alive]
        size = 2 * kept + 4 * len(self._leaves)
        self._parents = np.concatenate([np.where(parents >= 0, number[parents], -1), np.empty(size - kept, np.int64)])
        self._poses = np.concatenate([self._poses[: self._used][alive], np.empty((size - kept, 3))])
        if kept > 0:
            self._leaves = number[self._leaves]
        self._used = kept
