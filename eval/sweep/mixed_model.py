# SPDX-License-Identifier: MIT
"""Two regressions for runs that are grouped in drives, and drives in worlds, where each group has an effect of its own.

Worlds with the same features differ, so that the next world differs from the mean of such worlds; a fit without effects
of worlds would only say how well that mean is known. Both fits give draws from the approximate posterior distribution
of their parameters, the deviations of the effects among them.

Penalties, as standard deviations of normal priors: `SLOPE_PRIOR` for slopes per standard deviation of their column
(2.5 is the scale of Gelman, Jakulin, Pittau, Su, "A weakly informative default prior distribution for logistic and
other regression models", Annals of Applied Statistics 2(4), 2008), and 1 for the logarithm of each deviation of
effects, which keeps it away from 0 as Chung et al. ("A nondegenerate penalized likelihood estimator for variance
parameters in multilevel models", Psychometrika 78(4), 2013) advise for few groups.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, logsumexp

SLOPE_PRIOR = 2.5
"""Standard deviation of the prior of a slope per standard deviation of its column."""
_NODES = 9
"""Nodes of the Gauss-Hermite quadrature over an effect."""
_LOG_RATIOS = np.linspace(-3.0, 3.0, 61)
"""Logarithms of the ratio of the deviation of slopes to that of the residuals that `fit_slopes` tries."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """Parameters of a regression; the first row is the estimate, the others are draws from the posterior."""

    coefficients: NDArray[np.float64]
    """(1 + draws, columns of the design)."""
    deviations: NDArray[np.float64]
    """Standard deviations, (1 + draws, 2): of the effects of worlds, then of those of drives or of the residuals."""


def fit_odds(
    design: NDArray[np.float64],
    holds: NDArray[np.bool_],
    drive: NDArray[np.intp],
    world: NDArray[np.intp],
    *,
    draws: int,
) -> Fitted:
    """Logistic regression with normal effects of worlds and drives on the log odds.

    design (runs, columns), the first column constant; drive and world (runs,) are numbers. The likelihood is integrated
    over the effects by Gauss-Hermite quadrature (Breslow, Clayton, JASA 88, 1993); the draws are from the normal
    approximation at its maximum.
    """
    scale = np.array([1.0, *design[:, 1:].std(axis=0)])
    scale[scale == 0.0] = 1.0
    columns = design.shape[1]
    likelihood = _Integrated(design / scale, holds, drive, world)
    precision = np.array([0.0, *np.full(columns - 1, SLOPE_PRIOR**-2), 1.0, 1.0])

    def objective(parameters: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        value, gradient = likelihood(parameters)
        return 0.5 * float(precision @ parameters**2) - value, precision * parameters - gradient

    best = minimize(objective, np.zeros(columns + 2), jac=True, method="L-BFGS-B").x
    covariance = np.linalg.inv(_hessian(lambda at: objective(at)[1], best))
    found = np.vstack([best, np.random.default_rng(0).multivariate_normal(best, covariance, draws)])
    return Fitted(found[:, :-2] / scale, np.exp(found[:, -2:]))


class _Integrated:
    """Log-likelihood of the runs, integrated over the effects, and its gradient."""

    def __init__(
        self, design: NDArray[np.float64], holds: NDArray[np.bool_], drive: NDArray[np.intp], world: NDArray[np.intp]
    ) -> None:
        order = np.lexsort((drive, world))  # the runs of a drive, and the drives of a world, follow each other
        self._design, self._holds = design[order], holds[order].astype(np.float64)
        self._first_runs, self._drive = _groups(drive[order])
        self._first_drives, self._world = _groups(world[order][self._first_runs])
        self._nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
        self._log_weights = np.log(weights / weights.sum())

    def __call__(self, parameters: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """The log-likelihood at coefficients, log deviation of worlds, log deviation of drives; its gradient."""
        of_world, of_drive = np.exp(parameters[-2:])
        nodes = self._nodes
        # axes: runs (or drives, or worlds), effect of the world, effect of the drive
        logit = (self._design @ parameters[:-2])[:, None, None] + of_world * nodes[:, None] + of_drive * nodes
        sign = 2.0 * self._holds - 1.0
        runs = -np.logaddexp(0.0, -sign[:, None, None] * logit)
        in_drive = np.add.reduceat(runs, self._first_runs) + self._log_weights
        drives = logsumexp(in_drive, axis=2)
        in_world = np.add.reduceat(drives, self._first_drives) + self._log_weights
        worlds = logsumexp(in_world, axis=1)
        of_worlds = np.exp(in_world - worlds[:, None])[self._world]
        posterior = of_worlds[:, :, None] * np.exp(in_drive - drives[:, :, None])
        residual = (self._holds[:, None, None] - expit(logit)) * posterior[self._drive]
        gradient = [
            *(self._design.T @ residual.sum(axis=(1, 2))),
            of_world * float((residual.sum(axis=2) @ nodes).sum()),
            of_drive * float((residual.sum(axis=1) @ nodes).sum()),
        ]
        return float(worlds.sum()), np.array(gradient)


def _groups(numbers: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Of equal numbers that follow each other: where each group begins, and the group of each number."""
    begins = np.diff(numbers, prepend=numbers[:1] - 1) != 0
    return np.flatnonzero(begins), np.cumsum(begins) - 1


def _hessian(
    gradient: Callable[[NDArray[np.float64]], NDArray[np.float64]], at: NDArray[np.float64], step: float = 1e-4
) -> NDArray[np.float64]:
    """Central differences of a gradient, symmetric."""
    columns = [(gradient(at + e) - gradient(at - e)) / (2.0 * step) for e in step * np.eye(len(at))]
    matrix = np.array(columns)
    return 0.5 * (matrix + matrix.T)


def fit_slopes(
    design: NDArray[np.float64],
    z: NDArray[np.float64],
    y: NDArray[np.float64],
    drive: NDArray[np.intp],
    world: NDArray[np.intp],
    *,
    draws: int,
) -> Fitted:
    """Regression y = level of the drive + (design @ coefficients + effect of the world) * z + residual.

    design (runs, columns), the first column constant; z, y, drive and world (runs,). Levels of drives are removed by
    centring within each drive. For each ratio of the deviation of slopes to that of residuals the coefficients are
    those of generalised least squares; the ratio has its profile posterior (Pinheiro, Bates, "Mixed-Effects Models in S
    and S-PLUS", 2000, section 2.2).
    """
    _, index = np.unique(drive, return_inverse=True)
    size = np.bincount(index)

    def centred(values: NDArray[np.float64]) -> NDArray[np.float64]:
        means: NDArray[np.float64] = np.bincount(index, values) / size
        return values - means[index]

    x, z, y = centred(z)[:, None] * design, centred(z), centred(y)
    masks = [world == number for number in np.unique(world)]
    sums = [_Sums(x[m].T @ x[m], x[m].T @ y[m], x[m].T @ z[m], float(z[m] @ z[m]), float(z[m] @ y[m])) for m in masks]
    prior = np.diag((design.std(axis=0) / SLOPE_PRIOR) ** 2 + 1e-9)  # the constant has a spread of 0, and no prior
    freedom = max(len(y) - len(size) - design.shape[1], 1)
    solutions = [_given_ratio(sums, float(y @ y), prior, freedom, np.exp(ratio)) for ratio in _LOG_RATIOS]
    log_posterior = np.array([s.log_likelihood for s in solutions]) - 0.5 * _LOG_RATIOS**2
    weights = np.exp(log_posterior - log_posterior.max())
    rng = np.random.default_rng(0)
    chosen = [int(np.argmax(weights)), *rng.choice(len(weights), draws, p=weights / weights.sum())]
    coefficients, deviations = [], []
    for row, k in enumerate(chosen):
        s = solutions[k]
        drawn = s.mean if row == 0 else rng.multivariate_normal(s.mean, s.residual**2 * s.inverse)
        coefficients.append(drawn)
        deviations.append([s.residual * np.exp(_LOG_RATIOS[k]), s.residual])
    return Fitted(np.array(coefficients), np.array(deviations))


@dataclass(frozen=True, eq=False)
class _Solution:
    """Generalised least squares with one ratio of the deviations."""

    mean: NDArray[np.float64]
    inverse: NDArray[np.float64]
    residual: float
    """Standard deviation of the residuals."""
    log_likelihood: float


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums of products over the runs of a world: of the design x, of z and of y."""

    xx: NDArray[np.float64]
    xy: NDArray[np.float64]
    xz: NDArray[np.float64]
    zz: float
    zy: float


def _given_ratio(
    sums: Sequence[_Sums], total: float, prior: NDArray[np.float64], freedom: int, ratio: float
) -> _Solution:
    """Generalised least squares with slopes that deviate `ratio` times as much as residuals; total: sum of y^2."""
    shrink = [ratio**2 / (1.0 + ratio**2 * s.zz) for s in sums]  # Sherman-Morrison, world by world
    pairs = list(zip(sums, shrink, strict=True))
    normal = sum((s.xx - k * np.outer(s.xz, s.xz) for s, k in pairs), start=prior)
    right: NDArray[np.float64] = sum((s.xy - k * s.zy * s.xz for s, k in pairs), start=np.zeros(len(prior)))
    inverse = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    mean: NDArray[np.float64] = inverse @ right
    rest = total - sum(k * s.zy**2 for s, k in pairs) - float(mean @ right)
    residual = float(max(rest / freedom, 1e-12) ** 0.5)
    log_determinant = sum(float(np.log1p(ratio**2 * s.zz)) for s in sums)
    return _Solution(mean, inverse, residual, -freedom * float(np.log(residual)) - 0.5 * log_determinant)
