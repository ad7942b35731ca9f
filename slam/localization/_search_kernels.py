# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled part of global localisation: what one scan says of many poses in one map."""

from __future__ import annotations

import numpy as np

from slam._jit import kernel
from slam.matching._likelihood_kernels import scan_cost


@kernel
def score_poses(start, stop, grids, poses, hits, model, out):
    """Log-likelihood out (poses,) [nats, up to a constant] of a scan at poses [start, stop) of (poses, 3).

    All of them look at the map of particle 0.  hits (K, 2) end points in the robot's frame [m];  model: `BeamModel`
    """
    distances = np.empty((4, hits.shape[0]))
    for i in range(start, stop):
        out[i] = -scan_cost(grids, 0, poses[i, 0], poses[i, 1], poses[i, 2], hits, model, distances)
