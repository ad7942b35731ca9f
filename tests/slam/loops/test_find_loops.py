# SPDX-License-Identifier: MIT
"""How far a search for loops looks: the chain's covariances, scaled by how well the graph predicted earlier loops."""

import numpy as np
import pytest

from slam import se2
from slam.loops.find_loops import MEDIAN_CHI2, MIN_PREDICTIONS, MIN_SCALE, scale_of, squared_error


def squared_errors(scale: float, count: int) -> list[float]:
    """Squared errors of predictions whose covariance is `scale` times what is stated."""
    errors = np.random.default_rng(0).normal(size=(count, 3)) * np.sqrt(scale)
    return (errors**2).sum(axis=1).tolist()


@pytest.mark.parametrize("scale", [0.1, 0.3, 0.8])
def test_the_scale_is_that_of_the_errors(scale):
    assert scale_of(squared_errors(scale, 2000)) == pytest.approx(scale, rel=0.1)


def test_wrong_loops_among_them_hardly_move_it():
    squares = squared_errors(0.2, 80) + [1e6] * 20
    assert 0.1 < scale_of(squares) < 0.4


def test_it_never_widens_the_search_and_narrows_it_within_a_bound():
    assert scale_of(squared_errors(9.0, 100)) == 1.0
    assert scale_of([0.0] * 50) == MIN_SCALE


def test_few_loops_say_nothing():
    assert scale_of(squared_errors(0.1, MIN_PREDICTIONS - 1)) == 1.0


@pytest.mark.parametrize("heading", [0.0, 0.5 * np.pi, -2.5, np.pi])
def test_predictions_of_loops_in_any_direction_err_as_stated(heading):
    """A chain's covariance is long across its direction: that of the first map, not of the second."""
    rng = np.random.default_rng(3)
    true = np.array([3.0, -2.0, heading])
    chain, match = np.diag([0.05, 1.0, 0.02]) ** 2, np.diag([0.02, 0.04, 0.01]) ** 2
    squares = []
    for _ in range(2000):
        predicted = true + rng.multivariate_normal(np.zeros(3), chain)
        found = se2.compose(true, rng.multivariate_normal(np.zeros(3), match))
        squares.append(squared_error(predicted, chain, found, match))
    assert np.median(squares) == pytest.approx(MEDIAN_CHI2, rel=0.1)
