# SPDX-License-Identifier: MIT
"""Lines of a table of poses that hold none, as trackers write them where they have lost their target."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_FAR = 0.5
"""No robot gets so far between a pose and the one before [m]."""

Table = NDArray[np.float64]


def rows_with_pose(table: Table) -> NDArray[np.bool_]:
    """Tell which rows of a table (n, 7, 8, 13 or 17), `t x y z` and a rotation, hold a pose, (n,).

    Others have numbers that are not finite, a quaternion of zeros, or the origin between poses that are far from it.
    """
    if table.shape[1] not in (8, 17):
        finite: NDArray[np.bool_] = np.asarray(np.isfinite(table).all(axis=1), dtype=np.bool_)
        return finite
    poses = table[:, :8]
    known: NDArray[np.bool_] = np.isfinite(poses).all(axis=1) & (poses[:, 4:] != 0.0).any(axis=1)
    return known & ~_is_lost(poses, known)


def _is_lost(poses: Table, known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which poses (n, 8) are the origin though the last one before and the first one after are far from it."""
    at_origin = (poses[:, 1:4] == 0.0).all(axis=1) & (np.abs(poses[:, 4:]).max(axis=1) == 1.0)
    others = np.flatnonzero(~at_origin & known)
    after = np.searchsorted(others, np.arange(len(poses)))
    amid: NDArray[np.bool_] = at_origin & (after > 0) & (after < len(others))
    rows = np.flatnonzero(amid)
    around = np.stack([others[after[rows] - 1], others[after[rows]]])
    amid[rows] = np.linalg.norm(poses[around, 1:4], axis=2).min(axis=0) > _FAR
    return amid
