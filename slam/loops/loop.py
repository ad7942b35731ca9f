# SPDX-License-Identifier: MIT
"""A loop: two local maps that show the same place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.loops.correlative_match import Agreement
from slam.loops.pose_graph import Edges


class Loop(NamedTuple):
    """Two local maps that were found to show the same place."""

    first: int
    """Number of the earlier local map."""
    second: int
    """Number of the later one."""
    pose: se2.Pose
    """Pose of the second's anchor, seen from the first's, (3,)."""
    covariance: NDArray[np.float64]
    """Covariance of the pose, seen from the second, (3, 3)."""
    agreement: Agreement
    """How well the maps agree there."""
    overlap: float
    """Length of the walls that both maps show [m]."""
    was_closed: bool
    """Whether they agree at the relative pose of the given path, too."""


def edges_of(loops: Sequence[Loop]) -> Edges:
    """The loops as edges of the graph."""
    return Edges(
        np.array([loop.first for loop in loops], np.int64),
        np.array([loop.second for loop in loops], np.int64),
        np.array([loop.pose for loop in loops]).reshape(-1, 3),
        np.array([loop.covariance for loop in loops]).reshape(-1, 3, 3),
    )
