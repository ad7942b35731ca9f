# SPDX-License-Identifier: MIT
"""Does the covariance of a path match its errors? Normalised estimation error squared (NEES) of each pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose, between, compose, wrap_angle

MIN_VARIANCE = 1e-10
"""Smallest eigenvalue of a covariance that is judged: poses next to the first hardly differ from it."""


def path_nees(poses: Pose, truth: Pose, covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """NEES e^T P^-1 e of each pose relative to the first, (n,); 3 on average where the covariance is right.

    poses, truth (n, 3): of the same moments, each in its own frame;  covariances (n, 3, 3): of the poses relative to
    the first, along the axes of their frame. NaN where the covariance is too small to be inverted.
    Source: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", section 5.4.2.
    """
    expected = compose(poses[0], between(truth[0], truth))
    error = poses - expected
    error[:, 2] = wrap_angle(error[:, 2])
    judged = np.linalg.eigvalsh(covariances)[:, 0] > MIN_VARIANCE
    values = np.full(len(poses), np.nan)
    solved = np.linalg.solve(covariances[judged], error[judged][:, :, None])[:, :, 0]
    values[judged] = np.sum(error[judged] * solved, axis=1)
    return values
