# SPDX-License-Identifier: MIT
"""A graph of poses: the least squares estimate, its covariance, and loops weighed by how well they agree.

Lu, Milios, "Globally Consistent Range Scan Alignment for Environment Mapping", Autonomous Robots 1997; loops by
graduated non-convexity with truncated least squares (Yang, Antonante, Tzoumas, Carlone, "Graduated Non-Convexity for
Robust Spatial Perception", RA-L 2020), the chain of the robot's motion with full weight.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from slam import se2

MAX_STEPS = 50
"""Gauss-Newton steps at most."""
CONVERGED = 1e-7
"""A step of less than this ends the search [m, rad]."""
TRUNCATION = 16.27
"""Squared Mahalanobis distance beyond which a loop counts as wrong: 99.9 % of right ones stay below (chi^2, 3 degrees
of freedom)."""
GNC_FACTOR = 1.4
"""Growth of the control parameter from round to round (Yang et al. 2020, remark 5)."""
MAX_CONTROL = 100.0
"""Where the control parameter has come to this, the weights are 0 or 1 but for a hundredth about the truncation."""


class Edges(NamedTuple):
    """Relative poses measured between nodes."""

    first: NDArray[np.int64]
    """Numbers of the nodes that the others were seen from, (edges,)."""
    second: NDArray[np.int64]
    """Numbers of the nodes seen, (edges,)."""
    measured: NDArray[np.float64]
    """Pose of the second seen from the first, (edges, 3)."""
    covariance: NDArray[np.float64]
    """Covariance of the error, a twist seen from the second, (edges, 3, 3)."""


def join(*parts: Edges) -> Edges:
    """Edges of several sets, one after the other."""
    return Edges._make(np.concatenate(arrays) for arrays in zip(*parts, strict=True))


def squared_distances(poses: se2.Pose, edges: Edges) -> NDArray[np.float64]:
    """Squared Mahalanobis distances of the edges at poses (n, 3), (edges,)."""
    error, _ = _logarithms(_deviations(poses, edges))
    distances: NDArray[np.float64] = np.einsum(
        "ei,ei->e", error, np.linalg.solve(edges.covariance, error[..., None])[..., 0]
    )
    return distances


def _deviations(poses: se2.Pose, edges: Edges) -> se2.Pose:
    """Poses of the second nodes seen from where they were measured, (edges, 3)."""
    return se2.between(edges.measured, se2.between(poses[edges.first], poses[edges.second]))


def _logarithms(deviations: se2.Pose) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Logarithms of deviations (edges, 3), and their Jacobians (edges, 3, 3).

    The error of an edge is the twist that leads from the measured pose to the actual one (Sola, Deray, Atchuthan, "A
    micro Lie theory for state estimation in robotics", 2018, equations 158 and 162), as in GTSAM. `log_twist` gives the
    same for one motion without the Jacobian.
    """
    x, y, angle = deviations.T
    half = 0.5 * angle
    small = np.abs(half) < 1e-4
    safe = np.where(small, 1.0, half)
    stretch = np.where(small, 1.0 - half**2 / 3.0, safe / np.tan(safe))
    slope = np.where(small, -half / 3.0, 0.5 * (1.0 / np.tan(safe) - safe / np.sin(safe) ** 2))
    logs = np.stack([stretch * x + half * y, stretch * y - half * x, angle], axis=-1)
    J = np.zeros((len(logs), 3, 3))
    J[:, 0, 0] = J[:, 1, 1] = stretch
    J[:, 0, 1], J[:, 1, 0], J[:, 2, 2] = half, -half, 1.0
    J[:, 0, 2], J[:, 1, 2] = slope * x + 0.5 * y, slope * y - 0.5 * x
    return logs, J


class _Normal(NamedTuple):
    """The normal equations without the first pose, which is held."""

    factor: Any
    """Factors of the matrix by SuperLU."""
    gradient: NDArray[np.float64]
    """(3 (n - 1),)."""


def _normal_equations(poses: se2.Pose, edges: Edges, weights: NDArray[np.float64]) -> _Normal:
    """Gauss-Newton equations at poses (n, 3) with weights (edges,)."""
    error, J = _logarithms(_deviations(poses, edges))
    to_second = se2.rotation(-poses[edges.first, 2] - edges.measured[:, 2])
    apart = (poses[edges.second] - poses[edges.first])[:, :2]
    to_first = -to_second
    to_first[:, :2, 2] += np.einsum("eij,ej->ei", to_second[:, :2, :2], np.column_stack([apart[:, 1], -apart[:, 0]]))
    sides = (edges.first, J @ to_first), (edges.second, J @ to_second)
    information = weights[:, None, None] * np.linalg.inv(edges.covariance)
    gradient, blocks, rows, columns = np.zeros((len(poses), 3)), [], [], []
    for i, Ji in sides:
        projected = Ji.swapaxes(1, 2) @ information
        np.add.at(gradient, i, np.einsum("eil,el->ei", projected, error))
        for j, Jj in sides:
            blocks.append((projected @ Jj).ravel())
            row, column = np.broadcast_arrays(
                3 * i[:, None, None] + np.arange(3)[:, None], 3 * j[:, None, None] + np.arange(3)
            )
            rows.append(row.ravel())
            columns.append(column.ravel())
    size = 3 * len(poses)
    entries = np.concatenate(blocks), (np.concatenate(rows), np.concatenate(columns))
    return _Normal(splu(coo_matrix(entries, shape=(size, size)).tocsc()[3:, 3:]), gradient.ravel()[3:])


def optimise(poses: se2.Pose, edges: Edges, weights: NDArray[np.float64]) -> se2.Pose:
    """Poses (n, 3) of the least weighted squares; the first stays."""
    poses = poses.copy()
    for _ in range(MAX_STEPS):
        normal = _normal_equations(poses, edges, weights)
        step = normal.factor.solve(normal.gradient).reshape(-1, 3)
        poses[1:] -= step
        poses[:, 2] = se2.wrap_angle(poses[:, 2])
        if np.abs(step).max() < CONVERGED:
            break
    return poses


def optimise_robustly(poses: se2.Pose, chain: Edges, loops: Edges) -> tuple[se2.Pose, NDArray[np.float64]]:
    """Poses (n, 3), and which loops agree with them: weights (loops,) of 0 or 1.

    The chain has full weight. The loss of a loop begins as a convex one and becomes a truncated square bit by bit.
    """
    edges, ones = join(chain, loops), np.ones(len(chain.first))
    poses = optimise(poses, edges, np.ones(len(edges.first)))
    squares = squared_distances(poses, loops)
    mu = TRUNCATION / max(2.0 * float(squares.max(initial=0.0)) - TRUNCATION, TRUNCATION)
    while squares.max(initial=0.0) > TRUNCATION and mu < MAX_CONTROL:
        weights = _truncated_weights(squares, mu)
        poses = optimise(poses, edges, np.concatenate([ones, weights]))
        squares = squared_distances(poses, loops)
        mu *= GNC_FACTOR
    weights = (squares <= TRUNCATION).astype(np.float64)
    return optimise(poses, edges, np.concatenate([ones, weights])), weights


def _truncated_weights(squares: NDArray[np.float64], mu: float) -> NDArray[np.float64]:
    """Weights (loops,) of the surrogate of the truncated square (Yang et al. 2020, equation 14)."""
    between = np.sqrt(TRUNCATION * mu * (mu + 1.0) / np.maximum(squares, 1e-12)) - mu
    return np.clip(between, 0.0, 1.0)


class Marginals:
    """Covariances of poses relative to each other."""

    def __init__(self, poses: se2.Pose, edges: Edges, weights: NDArray[np.float64]) -> None:
        """Invert the equations at the optimum poses (n, 3)."""
        size = 3 * len(poses)
        inverse = np.zeros((size, size))
        inverse[3:, 3:] = _normal_equations(poses, edges, weights).factor.solve(np.eye(size - 3))
        self._poses = poses
        self._blocks = inverse.reshape(len(poses), 3, len(poses), 3).swapaxes(1, 2)

    def relative(self, first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.float64]:
        """Covariances (k, 3, 3) of nodes `second` (k,) seen from nodes `first` (k,), along the axes of these."""
        seen = se2.between(self._poses[first], self._poses[second])
        to_second = se2.rotation(-self._poses[first, 2])
        to_first = -to_second
        to_first[:, 0, 2], to_first[:, 1, 2] = seen[:, 1], -seen[:, 0]
        J = np.concatenate([to_first, to_second], axis=-1)
        blocks = self._blocks
        top = np.concatenate([blocks[first, first], blocks[first, second]], axis=-1)
        bottom = np.concatenate([blocks[second, first], blocks[second, second]], axis=-1)
        covariance: NDArray[np.float64] = J @ np.concatenate([top, bottom], axis=-2) @ J.swapaxes(-1, -2)
        return covariance
