# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the final pass: Gauss-Newton over a whole trajectory as a chain of 3 x 3 blocks."""

from __future__ import annotations

import numpy as np

from slam._array_kernels import copy_matrix, copy_values
from slam._jit import inlined, kernel
from slam._planar_kernels import cholesky, deviation, solve
from slam.motion._odometry_model_kernels import cost_of_components, log_components


@inlined
def linearise_step(before, after, motion, guess, e, A, B):
    """The deviation e (3,) of the pose after a step from the one that the odometry predicts, and its Jacobians by the
    pose before, A (3, 3), and by the pose after, B (3, 3); guess (3,) out: the predicted pose; all are written."""
    cos, sin = np.cos(before[2]), np.sin(before[2])
    dx, dy = cos * motion[0] - sin * motion[1], sin * motion[0] + cos * motion[1]
    guess[0], guess[1], guess[2] = before[0] + dx, before[1] + dy, before[2] + motion[2]
    e[0], e[1], e[2] = deviation(guess, after[0], after[1], after[2])
    cos, sin = np.cos(guess[2]), np.sin(guess[2])
    B[0, 0], B[0, 1], B[1, 0], B[1, 1], B[2, 2] = cos, sin, -sin, cos, 1.0
    A[0, 0], A[0, 1], A[1, 0], A[1, 1], A[2, 2] = -cos, -sin, sin, -cos, -1.0
    A[0, 2] = cos * dy - sin * dx + e[1]
    A[1, 2] = -sin * dy - cos * dx - e[0]


@kernel
def add_odometry_steps(prior, poses, motions, diagonal, coupling, gradient):
    """Add the cost of the odometry between all neighbours to the equations of the chain.

    poses (n, 3);  motions (n - 1, 3) measured displacements;  prior: precision (n - 1, 3, 3), log_scale (n - 1, 3)
    diagonal (n, 3, 3), coupling (n - 1, 3, 3) and gradient (n, 3) are added to. As in `linearise_motion` the shares
    of the components of the prior are held fixed.
    """
    guess, e = np.empty(3), np.empty(3)
    A, B = np.zeros((3, 3)), np.zeros((3, 3))
    for t in range(motions.shape[0]):
        linearise_step(poses[t], poses[t + 1], motions[t], guess, e, A, B)
        good, failed, jumped = log_components(prior.precision[t], prior.log_scale[t], e[0], e[1], e[2])
        cost = cost_of_components(good, failed, jumped)
        first, second, third = np.exp(good + cost), np.exp(failed + cost), np.exp(jumped + cost)
        for r in range(3):
            p = first * prior.precision[t, 0, r] + second * prior.precision[t, 1, r] + third * prior.precision[t, 2, r]
            for i in range(3):
                gradient[t, i] += A[r, i] * p * e[r]
                gradient[t + 1, i] += B[r, i] * p * e[r]
                for j in range(3):
                    diagonal[t, i, j] += A[r, i] * p * A[r, j]
                    diagonal[t + 1, i, j] += B[r, i] * p * B[r, j]
                    coupling[t, i, j] += A[r, i] * p * B[r, j]


@kernel
def add_calibration(prior, poses, motions, basis, coupling, precision, gradient):
    """Add to the equations what the odometry's systematic errors, scalars c with motion + basis c, have to do with it.

    motions (n - 1, 3), as calibrated so far;  basis (n - 1, 3, k);  prior: as for `add_odometry_steps`
    coupling (n, 3, k) between poses and c, precision (k, k) and gradient (k,) of c are added to
    """
    guess, e = np.empty(3), np.empty(3)
    A, B, M = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    k = basis.shape[2]
    J = np.empty((3, k))
    M[2, 2] = -1.0
    for t in range(motions.shape[0]):
        linearise_step(poses[t], poses[t + 1], motions[t], guess, e, A, B)
        good, failed, jumped = log_components(prior.precision[t], prior.log_scale[t], e[0], e[1], e[2])
        cost = cost_of_components(good, failed, jumped)
        first, second, third = np.exp(good + cost), np.exp(failed + cost), np.exp(jumped + cost)
        cos, sin = np.cos(motions[t, 2]), np.sin(motions[t, 2])
        M[0, 0], M[0, 1], M[0, 2] = -cos, -sin, e[1]
        M[1, 0], M[1, 1], M[1, 2] = sin, -cos, -e[0]
        for r in range(3):
            for j in range(k):
                J[r, j] = M[r, 0] * basis[t, 0, j] + M[r, 1] * basis[t, 1, j] + M[r, 2] * basis[t, 2, j]
        for r in range(3):
            p = first * prior.precision[t, 0, r] + second * prior.precision[t, 1, r] + third * prior.precision[t, 2, r]
            for j in range(k):
                gradient[j] += J[r, j] * p * e[r]
                for i in range(3):
                    coupling[t, i, j] += A[r, i] * p * J[r, j]
                    coupling[t + 1, i, j] += B[r, i] * p * J[r, j]
                for i in range(k):
                    precision[i, j] += J[r, i] * p * J[r, j]


@kernel
def factor_chain(diagonal, coupling, factors, eliminated):
    """Factors of a block tridiagonal matrix, L D L^T by blocks, the pivots by Cholesky (Golub, Van Loan 2013, section
    4.5.1); returns whether it is positive definite.

    diagonal (n, 3, 3), coupling (n - 1, 3, 3) upper blocks;  factors (n, 3, 3), eliminated (n - 1, 3, 3) out
    """
    n = diagonal.shape[0]
    pivot, column = diagonal[0].copy(), np.empty(3)
    for i in range(n):
        if not cholesky(pivot, factors[i]):
            return False
        if i + 1 == n:
            break
        for j in range(3):
            copy_values(coupling[i, :, j], column)
            solve(factors[i], column)
            copy_values(column, eliminated[i, :, j])
        copy_matrix(diagonal[i + 1], pivot)
        for r in range(3):
            for k in range(3):
                for j in range(3):
                    pivot[r, j] -= coupling[i, k, r] * eliminated[i, k, j]
    return True


@kernel
def solve_chain(factors, eliminated, coupling, right, x):
    """Solve the block tridiagonal system that `factor_chain` has factored: x (n, 3) out, right (n, 3)."""
    n = right.shape[0]
    for i in range(n):
        copy_values(right[i], x[i])
        if i > 0:
            for r in range(3):
                for k in range(3):
                    x[i, r] -= coupling[i - 1, k, r] * x[i - 1, k]
        solve(factors[i], x[i])
    for i in range(n - 2, -1, -1):
        for r in range(3):
            for k in range(3):
                x[i, r] -= eliminated[i, r, k] * x[i + 1, k]


@kernel
def multiply_chain(diagonal, coupling, x, out):
    """out (n, 3) = the block tridiagonal matrix times x (n, 3)."""
    n = x.shape[0]
    for i in range(n):
        for r in range(3):
            total = 0.0
            for k in range(3):
                total += diagonal[i, r, k] * x[i, k]
                if i + 1 < n:
                    total += coupling[i, r, k] * x[i + 1, k]
                if i > 0:
                    total += coupling[i - 1, k, r] * x[i - 1, k]
            out[i, r] = total


@inlined
def invert(factor, out):
    """Inverse (3, 3) of a block that has this Cholesky factor."""
    column = np.empty(3)
    for j in range(3):
        column[:] = 0.0
        column[j] = 1.0
        solve(factor, column)
        copy_values(column, out[:, j])


@kernel
def chain_covariances(factors, eliminated, out):
    """Diagonal blocks of the inverse of the block tridiagonal matrix that `factor_chain` has factored, out (n, 3, 3)
    (Takahashi, Fagan, Chen 1973)."""
    for t in range(factors.shape[0] - 1, -1, -1):
        invert(factors[t], out[t])
        if t + 1 < factors.shape[0]:
            add_following(eliminated[t], out[t + 1], out[t])


@inlined
def add_following(eliminated, after, here):
    """Add to the inverse of a pivot what follows in the chain: E C E^T with C (3, 3), the block after it."""
    for i in range(3):
        for k in range(3):
            product = 0.0
            for j in range(3):
                product += eliminated[i, j] * after[j, k]
            for r in range(3):
                here[i, r] += product * eliminated[r, k]


@kernel
def expected_step_errors(prior, poses, motions, factors, eliminated, sums):
    """Expected squared errors of the odometry's steps, in variances of the first component of its prior.

    prior: precision (n - 1, 3, 3), log_scale (n - 1, 3);  poses (n, 3);  motions (n - 1, 3)
    factors and eliminated: of `factor_chain`, at these poses
    sums (4,) out: over all steps, the first component's share times the error along, across, in heading, and 1

    A step's error is expected to be its square at the poses plus its variance, from the blocks of the inverse on and
    next to the diagonal (Takahashi, Fagan, Chen 1973).
    """
    guess, e = np.empty(3), np.empty(3)
    A, B = np.zeros((3, 3)), np.zeros((3, 3))
    here, cross, after = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    sums[:] = 0.0
    n = motions.shape[0]
    invert(factors[n], after)
    for t in range(n - 1, -1, -1):
        invert(factors[t], here)
        for i in range(3):
            for j in range(3):
                cross[i, j] = 0.0
                for k in range(3):
                    cross[i, j] -= eliminated[t, i, k] * after[k, j]
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    here[i, j] -= cross[i, k] * eliminated[t, j, k]
        linearise_step(poses[t], poses[t + 1], motions[t], guess, e, A, B)
        good, failed, jumped = log_components(prior.precision[t], prior.log_scale[t], e[0], e[1], e[2])
        share = np.exp(good + cost_of_components(good, failed, jumped))
        sums[3] += share
        for r in range(3):
            squared = e[r] * e[r]
            for i in range(3):
                for j in range(3):
                    squared += A[r, i] * (here[i, j] * A[r, j] + 2.0 * cross[i, j] * B[r, j])
                    squared += B[r, i] * after[i, j] * B[r, j]
            sums[r] += share * squared * prior.precision[t, 0, r]
        copy_matrix(here, after)
