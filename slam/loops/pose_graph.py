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


class Edges(NamedTuple):
    """Relative poses measured between nodes."""

    first: NDArray[np.int64]
    """Numbers of the nodes that the others were seen from, (edges,)."""
    second: NDArray[np.int64]
    """Numbers of the nodes seen, (edges,)."""
    measured: NDArray[np.float64]
    """Pose of the second seen from the first, (edges, 3)."""
    covariance: NDArray[np.float64]
    """Covariance of the error, seen from the second, (edges, 3, 3)."""


def join(*parts: Edges) -> Edges:
    """Edges of several sets, one after the other."""
    return Edges._make(np.concatenate(arrays) for arrays in zip(*parts, strict=True))


def errors(poses: se2.Pose, edges: Edges) -> NDArray[np.float64]:
    """Errors of the edges at poses (n, 3), seen from the second node, (edges, 3)."""
    predicted = se2.between(poses[edges.first], poses[edges.second])
    return se2.between(edges.measured, predicted)


def squared_distances(poses: se2.Pose, edges: Edges) -> NDArray[np.float64]:
    """Squared Mahalanobis distances of the edges at poses (n, 3), (edges,)."""
    error = errors(poses, edges)
    distances: NDArray[np.float64] = np.einsum(
        "ei,ei->e", error, np.linalg.solve(edges.covariance, error[..., None])[..., 0]
    )
    return distances


class _Normal(NamedTuple):
    """The normal equations without the first pose, which is held."""

    factor: Any
    """Factors of the matrix by SuperLU."""
    gradient: NDArray[np.float64]
    """(3 (n - 1),)."""


def _normal_equations(poses: se2.Pose, edges: Edges, weights: NDArray[np.float64]) -> _Normal:
    """Gauss-Newton equations at poses (n, 3) with weights (edges,)."""
    error = errors(poses, edges)
    information = weights[:, None, None] * np.linalg.inv(edges.covariance)
    turn = _rotations(poses[edges.first, 2] + edges.measured[:, 2])  # into the frame of the measured second pose
    delta = (poses[edges.second] - poses[edges.first])[:, :2]
    J2 = turn
    J1 = -turn
    across = np.stack([-delta[:, 1], delta[:, 0], np.zeros(len(delta))], axis=-1)
    J1 = J1.copy()
    J1[:, :, 2] -= np.einsum("eij,ej->ei", turn, across)
    blocks, rows, columns = [], [], []
    gradient = np.zeros((len(poses), 3))
    sides = ((edges.first, J1), (edges.second, J2))
    for i, Ji in sides:
        projected = np.einsum("eki,ekl->eil", Ji, information)
        np.add.at(gradient, i, np.einsum("eil,el->ei", projected, error))
        for j, Jj in sides:
            blocks.append(projected @ Jj)
            row, column = np.broadcast_arrays(
                3 * i[:, None, None] + np.arange(3)[:, None], 3 * j[:, None, None] + np.arange(3)
            )
            rows.append(row)
            columns.append(column)
    size = 3 * len(poses)
    stacked = (np.concatenate(x).ravel() for x in (blocks, rows, columns))
    values, row, column = stacked
    H = coo_matrix((values, (row, column)), shape=(size, size)).tocsc()[3:, 3:]
    return _Normal(splu(H), gradient.ravel()[3:])


def _rotations(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrices (n, 3, 3) that turn vectors by -angle (n,)."""
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 0, 1], turn[:, 1, 0] = np.sin(angle), -np.sin(angle)
    turn[:, 2, 2] = 1.0
    return turn


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
    """Poses (n, 3), and weights (loops,) in [0, 1] of loops of which some are wrong."""
    edges, ones = join(chain, loops), np.ones(len(chain.first))
    weights = np.ones(len(loops.first))
    poses = optimise(poses, edges, np.concatenate([ones, weights]))
    squares = squared_distances(poses, loops)
    mu = TRUNCATION / max(2.0 * float(squares.max(initial=0.0)) - TRUNCATION, 1e-9)
    while squares.max(initial=0.0) > TRUNCATION:
        low, high = mu / (mu + 1.0) * TRUNCATION, (mu + 1.0) / mu * TRUNCATION
        between = np.sqrt(TRUNCATION * mu * (mu + 1.0) / np.maximum(squares, 1e-12)) - mu
        weights = np.where(squares <= low, 1.0, np.where(squares >= high, 0.0, between))
        poses = optimise(poses, edges, np.concatenate([ones, weights]))
        squares = squared_distances(poses, loops)
        mu *= GNC_FACTOR
        if np.all((weights < 1e-3) | (weights > 1.0 - 1e-3)) and np.all((squares > TRUNCATION) == (weights < 0.5)):
            break
    return poses, weights


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
        to_second = _rotations(self._poses[first, 2])
        to_first = -to_second
        to_first[:, 0, 2], to_first[:, 1, 2] = seen[:, 1], -seen[:, 0]
        J = np.concatenate([to_first, to_second], axis=-1)
        blocks = self._blocks
        top = np.concatenate([blocks[first, first], blocks[first, second]], axis=-1)
        bottom = np.concatenate([blocks[second, first], blocks[second, second]], axis=-1)
        covariance: NDArray[np.float64] = J @ np.concatenate([top, bottom], axis=-2) @ J.swapaxes(-1, -2)
        return covariance
