# SPDX-License-Identifier: MIT
"""Does the filter's covariance match its errors? Normalised estimation error squared (NEES) of the online pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from eval.consistency import LEVEL, chi_square, errors_from_first, squared_errors, stacked
from eval.filter.step_table import Columns, column, pose_columns, updates

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
    error = errors_from_first(pose_columns(steps), pose_columns(steps, "true_"))
    covariance = stacked(partial(column, steps))
    known = updates(steps) & np.isfinite(error).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    rows = np.flatnonzero(known)
    floor = np.linalg.eigvalsh(covariance[rows])[:, 0] if len(rows) else np.zeros(0)
    usable = floor > MIN_VARIANCE
    rows_used = rows[usable]
    return rows_used, squared_errors(error[rows_used], covariance[rows_used]), int((~usable).sum())


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
