# SPDX-License-Identifier: MIT
"""NEES of a path against errors that were drawn from its covariances."""

import numpy as np
import pytest

from eval.consistency import path_nees
from slam.se2 import compose, inverse


@pytest.mark.parametrize("turned", [0.0, 2.5])
def test_errors_drawn_from_the_covariances_have_a_mean_of_three(turned):
    rng = np.random.default_rng(4)
    n = 4000
    truth = np.column_stack([rng.normal(size=(n, 2)) * 10.0, rng.uniform(-3.0, 3.0, n)])
    roots = rng.normal(size=(n, 3, 3)) * 0.01
    covariances = roots @ roots.swapaxes(1, 2) + 1e-6 * np.eye(3)
    errors = np.einsum("nij,nj->ni", np.linalg.cholesky(covariances), rng.normal(size=(n, 3)))
    covariances[0], errors[0] = 0.0, 0.0  # the first pose is the reference
    frame = np.array([3.0, -2.0, turned])  # truth and estimate have frames of their own
    nees = path_nees(truth + errors, compose(inverse(frame), truth), covariances)
    assert np.isnan(nees[0])
    assert np.nanmean(nees) == pytest.approx(3.0, abs=0.15)
    assert np.nanmean(path_nees(truth + 2.0 * errors, compose(inverse(frame), truth), covariances)) > 11.0
