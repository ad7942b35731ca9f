# SPDX-License-Identifier: MIT
"""Resampling schemes: exact laws for each draw, unbiasedness over many."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.config import ResampleConfig
from slam.particles.resampling import SCHEMES, resampling_is_due, stratified, systematic
from tests.slam.strategies import weights

ALMOST_ONE = float(np.nextafter(1.0, 0.0))


class Fixed:
    """A generator whose uniform numbers are all the same."""

    def __init__(self, u):
        self.u = u

    def uniform(self, size=None):
        return self.u if size is None else np.full(size, self.u)


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
@given(w=weights(), u=st.floats(0.0, 1.0, exclude_max=True) | st.sampled_from([0.0, ALMOST_ONE]))
@settings(deadline=None)
def test_ancestors_are_ascending_particles_of_positive_weight(scheme, w, u):
    ancestors = scheme(w, Fixed(u))
    assert len(ancestors) == len(w)
    assert np.all(np.diff(ancestors) >= 0)
    assert np.all(w[ancestors] > 0.0)


@given(w=weights(), u=st.floats(0.0, 1.0, exclude_max=True) | st.sampled_from([0.0, ALMOST_ONE]))
@settings(deadline=None)
def test_systematic_gives_each_particle_floor_or_ceil_of_its_share(w, u):
    offspring = np.bincount(systematic(w, Fixed(u)), minlength=len(w))
    assert np.all(np.abs(offspring - len(w) * w) < 1.0 + 1e-9)


@given(w=weights(), seed=st.integers(0, 99))
@settings(deadline=None)
def test_stratified_gives_each_particle_its_share_to_within_two(w, seed):
    offspring = np.bincount(stratified(w, np.random.default_rng(seed)), minlength=len(w))
    assert np.all(np.abs(offspring - len(w) * w) < 2.0 + 1e-9)


@given(w=weights(), seed=st.integers(0, 99))
@settings(deadline=None)
def test_residual_gives_each_particle_at_least_the_floor_of_its_share(w, seed):
    offspring = np.bincount(SCHEMES["residual"](w, np.random.default_rng(seed)), minlength=len(w))
    assert np.all(offspring >= np.floor(len(w) * w - 1e-9))


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
@pytest.mark.parametrize("w", [(0.45, 0.25, 0.2, 0.1), (0.97, 0.01, 0.01, 0.005, 0.005), (0.2,) * 5])
def test_the_mean_number_of_offspring_is_the_share(scheme, w):
    rng, w, rounds = np.random.default_rng(7), np.array(w), 4000
    total = np.zeros(len(w))
    for _ in range(rounds):
        total += np.bincount(scheme(w, rng), minlength=len(w))
    # the variance is largest for independent draws: n w (1 - w) a round
    bound = 4.5 * np.sqrt(len(w) * w * (1.0 - w) / rounds)
    assert np.all(np.abs(total / rounds - len(w) * w) < bound)


@pytest.mark.parametrize("name", ["systematic", "stratified", "residual"])
def test_equal_weights_keep_every_particle(name):
    np.testing.assert_array_equal(SCHEMES[name](np.full(7, 1.0 / 7.0), np.random.default_rng(3)), np.arange(7))


@pytest.mark.parametrize("name", ["systematic", "stratified", "residual"])
def test_better_schemes_vary_less_than_independent_draws(name):
    w = np.random.default_rng(0).dirichlet(np.ones(20))

    def variance(scheme):
        rng = np.random.default_rng(1)
        return np.var([np.bincount(scheme(w, rng), minlength=20) for _ in range(500)], axis=0).sum()

    assert variance(SCHEMES[name]) < 0.8 * variance(SCHEMES["multinomial"])


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
@pytest.mark.parametrize("count", [1, 3, 4, 100])
def test_any_number_of_offspring_has_the_shares_of_the_weights(scheme, count):
    rng, w = np.random.default_rng(8), np.array([0.45, 0.25, 0.2, 0.1])
    total = np.zeros(4)
    for _ in range(2000):
        ancestors = scheme(w, rng, count)
        assert len(ancestors) == count
        total += np.bincount(ancestors, minlength=4)
    np.testing.assert_allclose(total / (2000 * count), w, atol=0.035)


@pytest.mark.parametrize(
    ("when", "ess", "due"),
    [
        ("always", 10.0, True),
        ("never", 0.1, False),
        ("ess", 4.9, True),
        ("ess", 5.0, False),  # at the threshold they are kept
        ("ess", 9.0, False),
    ],
)
def test_resampling_is_due_below_the_threshold(when, ess, due):
    assert resampling_is_due(ResampleConfig(when=when, threshold=0.5), ess, 10) is due
