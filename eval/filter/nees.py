# SPDX-License-Identifier: MIT
"""Does the filter's covariance match its errors? Normalised estimation error squared (NEES) of the online pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from eval.filter.step_table import Columns, column, pose_columns, updates
from slam.se2 import Pose, between, compose, wrap_angle

LEVEL = 0.95
"""Confidence level of the band and of the ellipsoid."""
MIN_VARIANCE = 1e-8
"""Smallest eigenvalue of a covariance that is judged: below 0.1 mm and 0.006 degrees of standard deviation the
particles stand at one pose and there is no covariance."""


@dataclass(frozen=True)
class Consistency:
    """Normalised estimation error squared (NEES) of the online pose against the particles' covariance."""

    nees_mean: float
    """3 for a correct covariance of (x, y, theta); larger values mean that the covariance is too small."""
    nees_band: tuple[float, float]
    """The interval that holds the mean of as many INDEPENDENT steps with a probability of 95 % (chi-square)."""
    inside_share: float
    """Share of steps with the truth inside the 95 % ellipsoid; 0.95 for a correct covariance."""
    steps: int
    """Steps that were judged."""
    degenerate: int
    """Steps left out because all particles stood (nearly) at one pose."""


def nees(steps: Columns) -> tuple[NDArray[np.intp], NDArray[np.float64], int]:
    """Return NEES e^T P^-1 e of each update with truth and a covariance that can be inverted.

    The result holds the rows (k,), the values (k,), and the number of updates left out as degenerate. Errors are taken
    relative to the first pose, because the filter knows no other frame.
    """
    error = _first_pose_error(pose_columns(steps), pose_columns(steps, "true_"))
    xx, xy, yy, xt, yt, tt = (column(steps, f"cov_{c}") for c in ("xx", "xy", "yy", "xt", "yt", "tt"))
    covariance = np.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt], axis=-1).reshape(-1, 3, 3)
    known = updates(steps) & np.isfinite(error).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    rows = np.flatnonzero(known)
    floor = np.linalg.eigvalsh(covariance[rows])[:, 0] if len(rows) else np.zeros(0)
    usable = floor > MIN_VARIANCE
    rows_used = rows[usable]
    solved = np.linalg.solve(covariance[rows_used], error[rows_used][:, :, None])[:, :, 0]
    values: NDArray[np.float64] = np.sum(error[rows_used] * solved, axis=1)
    return rows_used, values, int((~usable).sum())


def consistency(steps: Columns) -> Consistency | None:
    """Judge the covariance of the online pose; None without truth or without a covariance to judge.

    Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", section 5.4.2;
    for particle filter SLAM, Bailey, Nieto, Nebot, ICRA 2006, who show that all of them become overconfident.
    Trap: the steps of one run are correlated, so the band is far too narrow for one run. It is meant for means over
    many seeds at one step; for one run read `inside_share` and the order of magnitude.
    """
    rows, values, degenerate = nees(steps)
    if len(rows) == 0:
        return None
    count = len(rows)
    return Consistency(
        nees_mean=float(values.mean()),
        nees_band=(
            chi_square((1.0 - LEVEL) / 2.0, 3 * count) / count,
            chi_square((1.0 + LEVEL) / 2.0, 3 * count) / count,
        ),
        inside_share=float(np.mean(values <= chi_square(LEVEL, 3))),
        steps=count,
        degenerate=degenerate,
    )


def chi_square(share: float, freedom: int) -> float:
    """Return a quantile of the chi-square distribution; scipy.stats has it too, but takes half a second to load."""
    return float(2.0 * gammaincinv(0.5 * freedom, share))


def _first_pose_error(estimate: Pose, truth: Pose) -> Pose:
    """Return estimate minus truth (n, 3) in the estimate's frame, with the first known truth placed on its estimate."""
    known = np.flatnonzero(np.isfinite(truth).all(axis=1))
    if len(known) == 0:
        return np.full_like(estimate, np.nan)
    first = known[0]
    expected = compose(estimate[first], between(truth[first], truth))
    error = estimate - expected
    error[:, 2] = wrap_angle(error[:, 2])
    return error
