# SPDX-License-Identifier: MIT
"""How far the refined poses may err, relative to the first: the covariance of the whole adjustment.

The inverse of all equations is never formed. Errors that bend the whole trajectory are smooth, so they are sought among
motions of key poses between which the others are carried along (a Galerkin projection, dense and small); what a single
pose errs by besides, the chain of scans and odometry between the keys tells, the keys held.

The model says that two scans err independently on one surfel. Where they do not (a door frame that looks different from
each side), deviations from the surfel persist, and their sums show it: the covariance of the gradient, summed within
each surfel, is what the data say about every direction (Liang, Zeger, "Longitudinal data analysis using generalized
linear models", Biometrika 1986; White 1980). No direction is taken to be surer than the model or these sums say.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, solve_triangular
from scipy.sparse import csr_matrix

from slam import se2
from slam.motion.interpolation import way_along
from slam.refinement._chain_kernels import chain_covariances, factor_chain
from slam.refinement.joint_equations import Equations, parts_of

KEY_DISTANCE = 0.5
"""Way between key poses [m] where their number allows it, by `way_along`."""
MAX_KEYS = 200
"""Largest number of key poses: the dense equations have three unknowns for each."""
HELD = 1e12
"""Precision with which key poses are held while the poses between them are looked at [1/m^2, 1/rad^2]."""


def pose_covariances(equations: Equations) -> NDArray[np.float64]:
    """Covariances of x, y [m] and heading [rad] along the axes of the map, the first pose held, (frames, 3, 3)."""
    poses, n = equations.poses, len(equations.poses)
    keys = _key_frames(poses)
    local = _local_covariances(equations, keys)
    if len(keys) < 2:
        return _seen_from_first(poses, local)
    before, share = _between(poses, keys)
    carried = _carry(poses, keys, before, share)
    columns = 3 * before[:, None] + np.arange(6)
    places = np.broadcast_to((3 * np.arange(n)[:, None] + np.arange(3))[:, :, None], carried.shape)
    entries = carried.ravel(), (places.ravel(), np.broadcast_to(columns[:, None, :], carried.shape).ravel())
    bends = _covariance_of_keys(equations, csr_matrix(entries, shape=(3 * n, 3 * len(keys))))
    bent = carried @ bends[columns[:, :, None], columns[:, None, :]] @ carried.swapaxes(1, 2)
    covariances: NDArray[np.float64] = _seen_from_first(poses, local) + bent
    return covariances


def _key_frames(poses: se2.Pose) -> NDArray[np.int64]:
    """Frames of the key poses: evenly along the way, without the first frame, whose own error is looked at apart."""
    way = way_along(se2.between(poses[:-1], poses[1:]))
    count = min(MAX_KEYS, int(way[-1] / KEY_DISTANCE) + 2, len(poses))
    frames = np.searchsorted(way, np.linspace(0.0, way[-1], count))
    frames[-1] = len(poses) - 1
    return np.unique(frames[frames > 0])


def _between(poses: se2.Pose, keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Number of the key before each pose, of the first where there is none, (frames,), and the share of the way from
    it to the next that the pose has covered, (frames,)."""
    way = way_along(se2.between(poses[:-1], poses[1:]))
    before = np.clip(np.searchsorted(keys, np.arange(len(poses)), side="right") - 1, 0, len(keys) - 2)
    begin, end = way[keys[before]], way[keys[before + 1]]
    return before, np.clip((way - begin) / np.maximum(end - begin, 1e-9), 0.0, 1.0)


def _levers(poses: se2.Pose, about: se2.Pose) -> NDArray[np.float64]:
    """Derivatives (frames, 3, 3) of poses by the motion of a body that carries them, given by that of `about`."""
    J = np.tile(np.eye(3), (len(poses), 1, 1))
    apart = poses[:, :2] - about[..., :2]
    J[:, 0, 2], J[:, 1, 2] = -apart[:, 1], apart[:, 0]
    return J


def _carry(
    poses: se2.Pose, keys: NDArray[np.int64], before: NDArray[np.int64], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Derivatives (frames, 3, 6) of the poses by the key before and the key after: each pose moves as a body with the
    one and with the other, blended by the way."""
    first = (1.0 - share)[:, None, None] * _levers(poses, poses[keys[before]])
    second = share[:, None, None] * _levers(poses, poses[keys[before + 1]])
    return np.concatenate([first, second], axis=2)


def _covariance_of_keys(equations: Equations, P: csr_matrix) -> NDArray[np.float64]:
    """Covariance (3 keys, 3 keys) of the key poses, the first held; P (3 frames, 3 keys): how poses move with them."""
    size = P.shape[1]
    seen, gradients = _projected_surfels(equations, P)
    calibrated = P.T @ equations.calibration.taken_from_poses().reshape(-1, 3)
    H = ((P.T @ _chain_matrix(equations) @ P - seen @ seen.T).toarray() - calibrated @ calibrated.T)[3:, 3:]
    summed = gradients[3:]
    lower = np.linalg.cholesky(H)
    whitened = solve_triangular(lower, summed.toarray(), lower=True)
    ratios, directions = eigh(whitened @ whitened.T)
    modes = solve_triangular(lower, directions, lower=True, trans="T")
    covariance = np.zeros((size, size))
    covariance[3:, 3:] = (modes * np.maximum(ratios, 1.0)) @ modes.T
    return covariance


def _chain_matrix(equations: Equations) -> csr_matrix:
    """The block tridiagonal part (3 frames, 3 frames)."""
    n = len(equations.poses)
    at = 3 * np.arange(n)[:, None, None] + np.zeros((3, 3), np.int64)
    row, column = at + np.arange(3)[:, None], at + np.arange(3)
    upper = equations.coupling
    entries = np.concatenate([equations.diagonal.ravel(), upper.ravel(), upper.swapaxes(1, 2).ravel()])
    rows = np.concatenate([row.ravel(), row[:-1].ravel(), row[1:].ravel()])
    columns = np.concatenate([column.ravel(), column[1:].ravel(), column[:-1].ravel()])
    return csr_matrix((entries, (rows, columns)), shape=(3 * n, 3 * n))


def _projected_surfels(equations: Equations, P: csr_matrix) -> tuple[csr_matrix, csr_matrix]:
    """P^T (3 keys, 3 frames) times both matrices of `_surfel_columns`, a part of the scans at a time."""
    parts = parts_of(equations.observations)
    projected = [[(P.T @ M).tocsr() for M in _surfel_columns(equations, begin, end)] for begin, end in parts]
    seen, gradients = (sum(matrices[1:], start=matrices[0]) for matrices in zip(*projected, strict=True))
    return seen, gradients


def _surfel_columns(equations: Equations, begin: int, end: int) -> tuple[csr_matrix, csr_matrix]:
    """Two matrices (3 frames, 2 surfels) of the scans [begin, end): B W^-1/2, whose product with its transpose is what
    the surfels take from the equations by following, and the gradients that the end points on each surfel make (none by
    its slope)."""
    seen = equations.observations
    first = seen.first[begin : end + 1]
    of_these = slice(first[0], first[-1])
    surfel, weight, residual = seen.surfel[of_these], seen.weight[of_these], seen.residual[of_these]
    frame = np.repeat(equations.with_scan[begin:end], np.diff(first))
    normal = equations.normal[surfel]
    blocks = np.stack([weight * normal[:, 0], weight * normal[:, 1], seen.heading_jacobian[of_these]])
    rows = 3 * frame + np.arange(3)[:, None]
    shape = (3 * len(equations.poses), len(equations.normal))
    place = rows.ravel(), np.tile(surfel, 3)
    follow = blocks / np.sqrt(np.maximum(equations.total[surfel], np.finfo(float).tiny))
    pull = blocks * np.divide(residual, weight, out=np.zeros_like(weight), where=weight > 0.0)
    return csr_matrix((follow.ravel(), place), shape=shape), csr_matrix((pull.ravel(), place), shape=shape)


def _local_covariances(equations: Equations, keys: NDArray[np.int64]) -> NDArray[np.float64]:
    """Covariances (frames, 3, 3) of the poses, the surfels and the key poses held."""
    n = len(equations.poses)
    diagonal, factors, eliminated = equations.diagonal.copy(), np.empty((n, 3, 3)), np.empty((n - 1, 3, 3))
    diagonal[keys] = HELD * np.eye(3)
    if not factor_chain(diagonal, equations.coupling, factors, eliminated):
        raise FloatingPointError("the equations of the final pass are not positive definite")
    out = np.empty((n, 3, 3))
    chain_covariances(factors, eliminated, out)
    return out


def _seen_from_first(poses: se2.Pose, local: NDArray[np.float64]) -> NDArray[np.float64]:
    """Local covariances (frames, 3, 3) with that of the first pose, by which all the others seem to err; the first
    has none."""
    J = _levers(poses, poses[0])
    relative: NDArray[np.float64] = local + J @ local[0] @ J.swapaxes(1, 2)
    relative[0] = 0.0
    return relative
