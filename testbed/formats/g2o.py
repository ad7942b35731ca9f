# SPDX-License-Identifier: MIT
"""Pose graphs in the g2o format, which g2o, GTSAM, Ceres' examples and SE-Sync read.

Source: https://github.com/RainerKuemmerle/g2o/wiki/File-Format-SLAM-2D. The information matrix of an edge is that of
the error seen from the measured pose of the second vertex, its upper triangle row by row.
"""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np

from eval.files.atomic_write import atomic_write
from slam import se2
from slam.loops import Edges

UPPER = np.triu_indices(3)


def write_g2o(path: str | os.PathLike[str], poses: se2.Pose, edges: Edges) -> None:
    """Write vertices at poses (n, 3) and edges, with all digits of float64.

    No `FIX`: GTSAM's reader ends at it without a word. Readers hold the first vertex.
    """
    lines = [*_vertices(poses), *_edges(edges)]
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _vertices(poses: se2.Pose) -> Iterator[str]:
    for number, pose in enumerate(poses.tolist()):
        yield f"VERTEX_SE2 {number} {' '.join(map(repr, pose))}"


def _edges(edges: Edges) -> Iterator[str]:
    upper = np.linalg.inv(edges.covariance)[:, *UPPER]
    for i, j, measured, information in zip(
        edges.first.tolist(), edges.second.tolist(), edges.measured.tolist(), upper.tolist(), strict=True
    ):
        yield f"EDGE_SE2 {i} {j} {' '.join(map(repr, [*measured, *information]))}"
