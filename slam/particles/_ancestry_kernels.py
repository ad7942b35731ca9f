# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled walks through the ancestry tree."""

from __future__ import annotations

import numpy as np

from slam._jit import kernel


@kernel
def walk_back(parents, node, out):
    """Nodes on the way from `node` to the root, written into out (depth,) from its end to its front."""
    for k in range(out.shape[0] - 1, -1, -1):
        out[k] = node
        node = parents[node]


@kernel
def mark_alive(parents, leaves):
    """True for each node that lies on the way from a leaf to the root; parents (nodes,), leaves (particles,)."""
    alive = np.zeros(parents.shape[0], np.bool_)
    for leaf in leaves:
        node = leaf
        while node >= 0 and not alive[node]:
            alive[node] = True
            node = parents[node]
    return alive
