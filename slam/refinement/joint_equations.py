# SPDX-License-Identifier: MIT
"""The linear equations of one round, of all poses and the odometry's calibration, and their solution.

    [ H    C ] [ x ]     [ g ]
    [ C^T  K ] [ c ] = - [ h ],    H = chain - B W^-1 B^T

with the surfels eliminated (`_normal_equations_kernels`). With the surfels held, H is a chain of 3 x 3 blocks, which is
factored; with the three numbers of the calibration besides, the equations are solved exactly by their Schur complement.
That is the preconditioner of conjugate gradients; their iterations let walls and poses move together. The numbers are
kept as one more row of three, so that vectors have the shape (frames + 1, 3).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.refinement._chain_kernels import factor_chain, multiply_chain, solve_chain
from slam.refinement._normal_equations_kernels import SurfelObservations, dot, subtract_schur_complement
from slam.refinement.odometry_calibration import CalibrationEquations

TOLERANCE = 1e-8
"""The equations count as solved where the residual, in the norm of the preconditioner, has fallen by this factor;
that norm hardly notices bends of the whole, so it has to be small."""
MAX_ITERATIONS = 500
"""Largest number of iterations of conjugate gradients in one round; the next round continues from there."""


OBSERVATIONS_AT_ONCE = 500_000
"""Blocks between scans and surfels that are looked at together outside of kernels: some hundred bytes each."""


def parts_of(observations: SurfelObservations) -> list[tuple[int, int]]:
    """Ranges [begin, end) of scans with about `OBSERVATIONS_AT_ONCE` blocks each, which together are all scans."""
    first = observations.first
    begins = np.searchsorted(first, np.arange(OBSERVATIONS_AT_ONCE, first[-1], OBSERVATIONS_AT_ONCE), side="right") - 1
    return list(pairwise(np.unique([0, *begins.tolist(), len(first) - 1]).tolist()))


class Equations(NamedTuple):
    """The left sides, as a round of the adjustment sets them up."""

    poses: se2.Pose
    """Poses at which they were set up, (frames, 3)."""
    with_scan: NDArray[np.int64]
    """Frames to which the scans belong, (scans,)."""
    diagonal: NDArray[np.float64]
    """Diagonal blocks of odometry and scans, the surfels held, (frames, 3, 3)."""
    coupling: NDArray[np.float64]
    """Blocks of the odometry between neighbours, (frames - 1, 3, 3)."""
    calibration: CalibrationEquations
    """The blocks of the odometry's calibration."""
    observations: SurfelObservations
    """The blocks between scans and surfels."""
    normal: NDArray[np.float64]
    """Normals of the surfels, once for their offsets and once for their slopes, (2 surfels, 2)."""
    total: NDArray[np.float64]
    """Precisions of offsets [1/m^2] and slopes [1/rad^2], the poses held, (2 surfels,)."""


class JointEquations:
    """The equations with the factors of their chain."""

    def __init__(self, equations: Equations) -> None:
        """Factor the chain; raises FloatingPointError where it is not positive definite."""
        self.equations, n = equations, len(equations.poses)
        self.factors, self.eliminated = np.empty((n, 3, 3)), np.empty((n - 1, 3, 3))
        if not factor_chain(equations.diagonal, equations.coupling, self.factors, self.eliminated):
            raise FloatingPointError("the equations of the final pass are not positive definite")
        C, K = equations.calibration.coupling, equations.calibration.precision
        columns = [self._solve_chain(np.ascontiguousarray(C[:, :, j])) for j in range(3)]
        self._follows = np.stack(columns, axis=-1)  # of the poses, the surfels held, by the numbers
        self._held = np.linalg.inv(K - np.einsum("nij,nik->jk", C, self._follows))

    def solve(self, gradient: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solution for right sides -gradient (frames + 1, 3)."""
        return -conjugate_gradients(self._product, self._precondition, gradient)

    def calibration_covariance(self) -> NDArray[np.float64]:
        """Covariance of the numbers of the calibration, (3, 3)."""
        columns = []
        for j in range(3):
            unit = np.zeros((len(self.equations.poses) + 1, 3))
            unit[-1, j] = 1.0
            columns.append(conjugate_gradients(self._product, self._precondition, unit)[-1])
        return np.stack(columns, axis=1)

    def _product(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        e, C = self.equations, self.equations.calibration.coupling
        x, c, out = z[:-1], z[-1], np.empty_like(z)
        moved, followed = np.empty_like(x), np.zeros((len(e.with_scan), 3))
        multiply_chain(e.diagonal, e.coupling, x, moved)
        seen = np.ascontiguousarray(x[e.with_scan])
        subtract_schur_complement(e.observations, e.normal, e.total, seen, followed)
        moved[e.with_scan] += followed
        out[:-1] = moved + np.einsum("nij,j->ni", C, c)
        out[-1] = np.einsum("nij,ni->j", C, x) + np.einsum("ij,j->i", e.calibration.precision, c)
        return out

    def _precondition(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """The exact solution with the surfels held."""
        out, alone = np.empty_like(z), self._solve_chain(z[:-1])
        rest = z[-1] - np.einsum("nij,ni->j", self.equations.calibration.coupling, alone)
        out[-1] = np.einsum("ij,j->i", self._held, rest)
        out[:-1] = alone - np.einsum("nij,j->ni", self._follows, out[-1])
        return out

    def _solve_chain(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.empty_like(x)
        solve_chain(self.factors, self.eliminated, self.equations.coupling, x, out)
        return out


def conjugate_gradients(
    product: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    precondition: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    right: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Solve H x = right for a symmetric positive semidefinite H; right and x (n, 3).

    Preconditioned conjugate gradients (Golub, Van Loan 2013, algorithm 11.5.1).
    """
    x, residual = np.zeros_like(right), right.copy()
    z = precondition(residual)
    direction = z.copy()
    rz = start = dot(residual, z)
    for _ in range(MAX_ITERATIONS):
        if rz <= TOLERANCE**2 * start:
            break
        image = product(direction)
        curvature = dot(direction, image)
        if not curvature > 0.0:  # a direction that nothing holds but round-off
            break
        alpha = rz / curvature
        x += alpha * direction
        residual -= alpha * image
        z = precondition(residual)
        before, rz = rz, dot(residual, z)
        direction = z + rz / before * direction
    return x
