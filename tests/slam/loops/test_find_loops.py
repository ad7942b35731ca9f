# SPDX-License-Identifier: MIT
"""How far a search for loops looks: the chain's covariances, scaled by how well the graph predicted earlier loops."""

import numpy as np
import pytest

from slam.loops.find_loops import MIN_PREDICTIONS, MIN_SCALE, scale_of


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
