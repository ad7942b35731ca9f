# SPDX-License-Identifier: MIT
"""Does a covariance match the errors? Normalised estimation error squared (NEES) of poses relative to the first.

Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", section 5.4.2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from slam.se2 import Pose, between, compose, wrap_angle

LEVEL = 0.95
"""Confidence level of bands and ellipsoids."""
MIN_VARIANCE = 1e-10
"""Smallest eigenvalue of a covariance that is judged: poses next to the first hardly differ from it."""


def path_nees(poses: Pose, truth: Pose, covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """NEES e^T P^-1 e of each pose relative to the first, (n,); 3 on average where the covariance is right.

    poses, truth (n, 3): of the same moments, each in its own frame;  covariances (n, 3, 3): of the poses relative to
    the first, along the axes of their frame. NaN where the covariance is too small to be inverted.
    """
    judged = np.linalg.eigvalsh(covariances)[:, 0] > MIN_VARIANCE
    values = np.full(len(poses), np.nan)
    values[judged] = squared_errors(errors_from_first(poses, truth)[judged], covariances[judged])
    return values


def errors_from_first(poses: Pose, truth: Pose) -> Pose:
    """Poses minus true ones (n, 3), in the frame of the poses, with the first known truth placed on its pose.

    truth (n, 3): NaN where it is unknown. Where it begins late, the first known pose, which has an error of its own, is
    taken for exact: the errors are then relative to it, while the covariances are not, and the NEES is biased.
    """
    known = np.flatnonzero(np.isfinite(truth).all(axis=1))
    if len(known) == 0:
        return np.full_like(poses, np.nan)
    first = known[0]
    error = poses - compose(poses[first], between(truth[first], truth))
    error[:, 2] = wrap_angle(error[:, 2])
    return error


def squared_errors(errors: Pose, covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """e^T P^-1 e of errors (n, 3) with covariances (n, 3, 3), (n,)."""
    solved = np.linalg.solve(covariances, errors[:, :, None])[:, :, 0]
    values: NDArray[np.float64] = np.sum(errors * solved, axis=1)
    return values


def stacked(column: Callable[[str], NDArray[np.float64]]) -> NDArray[np.float64]:
    """Covariances (n, 3, 3) from the columns `cov_xx`, `cov_xy`, `cov_yy`, `cov_xt`, `cov_yt`, `cov_tt` of a table.

    column: returns the one of a name, (n,)
    """
    xx, xy, yy, xt, yt, tt = (column(f"cov_{name}") for name in ("xx", "xy", "yy", "xt", "yt", "tt"))
    return np.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt], axis=-1).reshape(-1, 3, 3)


def chi_square(share: float, freedom: int) -> float:
    """A quantile of the chi-square distribution; scipy.stats has it too, but takes half a second to load."""
    return float(2.0 * gammaincinv(0.5 * freedom, share))
