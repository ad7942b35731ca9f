# SPDX-License-Identifier: MIT
"""Stretches on which no scan tells how far the robot has come, and a path that follows the odometry on them.

In a bare corridor nothing holds a path along the walls but the odometry. A filter may slip there by metres, since each
of its steps is matched alone, and walls that were drawn along such a path, doors twice, hold it where it is: the final
pass then finds a path that agrees with itself, and not with the odometry. From a path that follows the odometry on
these stretches, and the given one elsewhere, it may find another; see `Refined.along_odometry`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.refinement.joint_equations import Equations, parts_of

BLIND_SIGMA = 0.1
"""A scan is blind where it leaves a standard deviation of position of more than this open in some direction [m]. A
wall across that direction with a dozen readings leaves a centimetre open; noise in the normals of walls along it alone
leaves 0.2 to 0.5 m."""
SURE_SIGMA = 0.02
"""A blind stretch ends at scans that leave less than this open [m]. Between, a few far readings hold the path, or stray
ones in front of walls."""
MIN_WAY = 2.0
"""Blind stretches matter from this way between blind scans on [m]; over less, odometry that is wrong by a tenth errs no
more than the first gate of the adjustment forgives."""


def blind_steps(equations: Equations, seen: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each step between frames lies in a blind stretch, (frames - 1,).

    seen (scans, 3, 3): information of each scan about its pose, the walls held. A stretch has `MIN_WAY` or more between
    blind scans, and goes on to both sides as long as no scan is sure.
    """
    poses, with_scan = equations.poses, equations.with_scan
    steps = np.zeros(len(poses) - 1, np.bool_)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])[with_scan]
    weakest = np.linalg.eigvalsh(by_other_scans(equations, seen)[:, :2, :2])[:, 0]
    blind = weakest < BLIND_SIGMA**-2
    blind_way = np.concatenate([[0.0], np.cumsum(np.diff(way) * (blind[:-1] & blind[1:]))])
    edges = np.diff(np.concatenate([[0], (weakest < SURE_SIGMA**-2).astype(np.int8), [0]]))
    for first, after in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        if blind_way[after - 1] - blind_way[first] >= MIN_WAY:
            steps[with_scan[first] : with_scan[after - 1]] = True
    return steps


def by_other_scans(equations: Equations, seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """Information about the pose of each scan where the other scans' poses are held and walls follow, (scans, 3, 3).

    seen (scans, 3, 3): the same with the walls held. A wall that no other scan has seen follows the scan, and tells
    nothing of it.
    """
    rows, normal = equations.observations, equations.normal
    left = seen.copy()
    for begin, end in parts_of(rows):
        of_these = slice(rows.first[begin], rows.first[end])
        scan = np.repeat(np.arange(begin, end), np.diff(rows.first[begin : end + 1]))
        surfel = rows.surfel[of_these]
        b = np.column_stack([rows.weight[of_these, None] * normal[surfel], rows.heading_jacobian[of_these]])
        b /= np.sqrt(np.maximum(equations.total[surfel], np.finfo(float).tiny))[:, None]
        np.subtract.at(left, scan, b[:, :, None] * b[:, None, :])
    return left


def along_odometry(poses: se2.Pose, motions: se2.Pose, steps: NDArray[np.bool_]) -> se2.Pose:
    """The path with the distances of the odometry on some steps, headings as they are.

    poses (frames, 3);  motions (frames - 1, 3): displacements by the odometry;  steps (frames - 1,): where they count
    """
    turned = se2.rotation(poses[:-1, 2])[:, :2, :2]
    displaced = np.diff(poses[:, :2], axis=0)
    displaced[steps] = np.einsum("nij,nj->ni", turned[steps], motions[steps, :2])
    path = poses.copy()
    path[1:, :2] = poses[0, :2] + np.cumsum(displaced, axis=0)
    return path
