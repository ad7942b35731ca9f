# SPDX-License-Identifier: MIT
"""Where the lidar sits, as its own motion shows it, against where the recording says that it sits.

The estimated path is that of the point that would be the robot's centre if the stated mount were right. If the lidar
really sits D = (d, angle) further, this point is at D in the frame of the robot's centre. While odometry says that the
centre moves by u (2,) in a turn w, the point moves by p (2,), and

    u = (I - R(w)) d + (1 + s) R(angle) p

with the share s by which odometry counts too much: driving straight on shows the angle, turns show d. (This is the
hand-eye equation of Censi, Franchi, Marchionni, Oriolo, T-RO 2013, with the path in place of single scan matches.)

The turns are those of the path, which a wrong mount does not change, so an odometry that bends does no harm. The drive
is cut into pieces of about a metre. What odometry errs within a piece is its own; what the path errs where two pieces
meet belongs to both. Both variances are taken from the residuals, and the equations are solved by generalised least
squares. The deviations are at least those by which estimates from parts of the drive differ.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded

from slam import se2
from slam.se2 import Pose
from testbed.frame_table import Floats

PIECE = 1.0
"""Length of a piece, where a radian counts as a metre [m]."""
MIN_PIECES = 15
"""Fewer pieces do not show how errors spread."""
ROUNDS = 6
"""Rounds of the fit; angle and variances no longer change after the fourth."""
OUTLIER = 4.0
"""Pieces off by more standard deviations are left out: slips, and places where the path is wrong."""
LEFT_OUT = 100.0
"""Variance of a piece that is left out [m^2]."""
MIN_DEVIATION, MIN_PATH_DEVIATION = 0.001, 0.001
"""The least that a metre of odometry and a pose of the path err [m]: residuals of few pieces may show less."""
SCALE_DEVIATION = 0.1
"""How far the scale of an odometry may be off, before the data are seen."""
PARTS = 10
"""Number of parts of the drive whose estimates are compared."""
SYSTEMATIC = 0.002, 0.002, math.radians(0.05)
"""Standard deviations of what no residual shows: wheels of unequal size, which look like a lidar that sits sideways, a
sweep whose beams count as taken at once [m, m, rad]."""
CERTAIN = 4.0
"""An error of so many standard deviations is no chance."""
LEAST = 0.01, 0.01, math.radians(0.5)
"""Smaller errors of a mount do no harm, or are those of a robot that drives slightly askew [m, m, rad]."""

BAND = 3
"""Codiagonals of the covariance of all displacements: two neighbouring pieces have four numbers."""


class MountError(NamedTuple):
    """By how much a mount differs from the stated one."""

    offset: Floats
    """D in the robot's frame, (3,) [m, m, rad]: the true mount is D composed with the stated one."""
    deviations: Floats
    """Standard deviations of `offset`, (3,)."""
    scale: float
    """Metres that odometry counts for each metre driven."""
    scale_deviation: float

    @property
    def significant(self) -> tuple[bool, bool, bool]:
        """Which of x, y and the angle are surely wrong, and enough to matter."""
        x, y, angle = (np.abs(self.offset) > np.maximum(CERTAIN * self.deviations, LEAST)).tolist()
        return x, y, angle

    def in_words(self) -> str:
        """Say where the lidar sits, as far as that is known and wrong; empty where nothing is."""
        x, y, angle = self.offset.tolist()
        sigmas = self.deviations * [100.0, 100.0, math.degrees(1.0)]
        parts = (
            f"{100.0 * abs(x):.1f} ± {sigmas[0]:.1f} cm further {'ahead' if x > 0.0 else 'back'}",
            f"{100.0 * abs(y):.1f} ± {sigmas[1]:.1f} cm further {'left' if y > 0.0 else 'right'}",
            f"turned by {math.degrees(abs(angle)):.1f} ± {sigmas[2]:.1f} deg {'left' if angle > 0.0 else 'right'}",
        )
        return ", ".join(part for part, wrong in zip(parts, self.significant, strict=True) if wrong)


class _Pieces(NamedTuple):
    """Displacements within pieces, each in the frame of its begin."""

    odometry: Floats
    """u, (n, 2) [m]."""
    path: Floats
    """p, (n, 2) [m]."""
    turn: Floats
    """w [rad], (n,)."""
    length: Floats
    """Distance by odometry [m], (n,)."""


class _Variances(NamedTuple):
    """How far the displacements err."""

    odometry: Floats
    """For each metre, forward and sideways [m], (2,)."""
    path: float
    """Of a position at the end of a piece [m^2]."""


def find_mount_error(odometry: Pose, path: Pose) -> MountError | None:
    """Compare odometry `T_odom_robot` (n, 3) with the estimated path (n, 3) at the same times.

    None where the drive is too short.
    """
    pieces = _cut(odometry, path)
    n = len(pieces.turn)
    if n < MIN_PIECES:
        return None
    angle = float(np.angle(np.sum(_complex(pieces.odometry) * _complex(pieces.path).conj())))
    variances, used = _Variances(np.full(2, 1e-4), 1e-5), np.ones((n, 2), dtype=bool)
    for _ in range(ROUNDS):
        turned = _rotated(pieces.path, np.full(n, angle))
        design, target = _equations(pieces.turn, turned), pieces.odometry - turned
        weighted = _weighted(np.dstack([design, target]), pieces, variances, used)
        normal = np.einsum("nri,nrj->ij", design, weighted[:, :, :4]) + np.diag([0.0, 0.0, 0.0, SCALE_DEVIATION**-2])
        solution = np.linalg.solve(normal, np.einsum("nri,nr->i", design, weighted[:, :, 4]))
        residuals = target - design @ solution
        angle += float(solution[2])
        variances, used = _spread(residuals, pieces, used)
    scores = np.einsum("nri,nr->ni", design, weighted[:, :, 4] - weighted[:, :, :4] @ solution)
    deviations = np.maximum(np.sqrt(np.diag(np.linalg.inv(normal))), _by_parts(scores, normal))
    return MountError(
        np.array([solution[0], solution[1], math.remainder(angle, 2.0 * math.pi)]),
        np.hypot(deviations[:3], SYSTEMATIC),
        1.0 + float(solution[3]),
        float(deviations[3]),
    )


def _cut(odometry: Pose, path: Pose) -> _Pieces:
    """Cut a drive into pieces; the turns within steps of the odometry are replaced by those of the path."""
    steps, heading = se2.between(odometry[:-1], odometry[1:]), np.unwrap(path[:, 2])
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    moved = np.append(0.0, np.cumsum(lengths + np.abs(steps[:, 2])))
    cuts = np.flatnonzero(np.diff(np.floor(moved / PIECE), prepend=-1.0) > 0.0)
    along = heading[:-1] + 0.5 * (np.diff(heading) - steps[:, 2])
    ways = np.concatenate([np.zeros((1, 2)), np.cumsum(_rotated(steps[:, :2], along), axis=0)])
    begin, end = cuts[:-1], cuts[1:]
    return _Pieces(
        odometry=_rotated(ways[end] - ways[begin], -heading[begin]),
        path=_rotated(path[end, :2] - path[begin, :2], -heading[begin]),
        turn=heading[end] - heading[begin],
        length=np.diff(np.append(0.0, np.cumsum(lengths))[cuts]),
    )


def _equations(turn: Floats, turned: Floats) -> Floats:
    """Derivatives of u by d, a further turn of p and the scale, (n, 2, 4); turn (n,), turned (n, 2)."""
    cos, sin = np.cos(turn), np.sin(turn)
    forward = np.stack([1.0 - cos, sin, -turned[:, 1], turned[:, 0]], axis=1)
    sideways = np.stack([-sin, 1.0 - cos, turned[:, 0], turned[:, 1]], axis=1)
    return np.stack([forward, sideways], axis=1)


def _weighted(columns: Floats, pieces: _Pieces, variances: _Variances, used: NDArray[np.bool_]) -> Floats:
    """Columns (n, 2, k) times the inverse of the covariance of all displacements; used (n, 2)."""
    n = len(pieces.turn)
    band = np.zeros((BAND + 1, 2 * n))  # the lower form of LAPACK: band[i - j, j] is row i, column j
    each = variances.odometry * pieces.length[:, None] + 2.0 * variances.path + LEFT_OUT * ~used
    band[0] = each.reshape(-1)
    cos, sin = np.cos(pieces.turn[:-1]), np.sin(pieces.turn[:-1])
    shared = -variances.path  # what a position errs ends one piece, R(w) e, and begins the next, -e
    band[2, 0:-2:2], band[3, 0:-2:2] = shared * cos, -shared * sin
    band[1, 1:-2:2], band[2, 1:-2:2] = shared * sin, shared * cos
    solved = cho_solve_banded((cholesky_banded(band, lower=True), True), columns.reshape(2 * n, -1))
    result: Floats = solved.reshape(columns.shape)
    return result


def _spread(residuals: Floats, pieces: _Pieces, used: NDArray[np.bool_]) -> tuple[_Variances, NDArray[np.bool_]]:
    """Variances by the residuals (n, 2), and which of these are no outliers, (n, 2)."""
    both = used[:-1].all(axis=1) & used[1:].all(axis=1)
    common = -0.5 * np.sum(_rotated(residuals[1:], pieces.turn[:-1]) * residuals[:-1], axis=1)[both]
    path = max(float(common.mean()) if common.size else 0.0, MIN_PATH_DEVIATION**2)
    squares = np.where(used, residuals**2 - 2.0 * path, 0.0).sum(axis=0)
    lengths = np.where(used, pieces.length[:, None], 0.0).sum(axis=0)
    odometry = np.maximum(squares / np.maximum(lengths, 1e-9), MIN_DEVIATION**2)
    expected = np.sqrt(odometry * pieces.length[:, None] + 2.0 * path)
    usual = 1.4826 * np.median(np.abs(residuals) / expected, axis=0)
    return _Variances(odometry, path), np.abs(residuals) < OUTLIER * np.minimum(usual, 1.0) * expected


def _by_parts(scores: Floats, normal: Floats) -> Floats:
    """Standard deviations (4,) by how far the parts of the drive pull the estimate apart; scores (n, 4).

    The sandwich estimator with clusters (Liang, Zeger 1986)."""
    parts = np.array([part.sum(axis=0) for part in np.array_split(scores, PARTS)])
    inverse = np.linalg.inv(normal)
    deviations: Floats = np.sqrt(np.diag(inverse @ (parts.T @ parts) @ inverse) * PARTS / (PARTS - 1))
    return deviations


def _rotated(vectors: Floats, angles: Floats) -> Floats:
    """Vectors (n, 2), each turned by its angle (n,) [rad]."""
    cos, sin = np.cos(angles), np.sin(angles)
    x, y = vectors.T
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)


def _complex(vectors: Floats) -> NDArray[np.complex128]:
    """Vectors (n, 2) as complex numbers."""
    return vectors[:, 0] + 1j * vectors[:, 1]
