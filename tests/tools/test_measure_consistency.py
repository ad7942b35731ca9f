# SPDX-License-Identifier: MIT
"""What the page on consistency says of errors that runs share, and of those in which they differ."""

import numpy as np
import pytest

from tools.measure.measure_consistency import Consistency, mean_over_time, scatter_nees


def drive(error, sigma):
    """A run of 8 s, an update a second, with the same error (3,) and standard deviations (3,) throughout."""
    stamps = np.arange(0.0, 9.0)
    covariance = np.diag(np.square(sigma))
    value = float(np.sum(np.square(np.divide(error, sigma))))
    return Consistency(stamps, np.tile(error, (9, 1)), np.tile(covariance, (9, 1, 1)), np.full(9, value))


def test_a_shared_error_counts_in_the_nees_and_not_in_that_of_the_scatter():
    """Errors that scatter by one standard deviation in each of three numbers, about a mean error of ten of them."""
    sigma = np.array([0.02, 0.01, 0.005])
    signs = np.array([(1, 1, -1), (1, -1, 1), (-1, 1, 1), (-1, -1, -1)])
    runs = [drive((signs[k] + (10.0, 0.0, 0.0)) * sigma, sigma) for k in range(4)]
    assert mean_over_time(runs)[1] == pytest.approx(103.0)
    assert scatter_nees(runs) == pytest.approx(3.0 * 4.0 / 3.0)  # unbiased: four deviations from their own mean
