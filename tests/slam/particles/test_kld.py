# SPDX-License-Identifier: MIT
"""Number of particles by the KLD bound: the table in Fox's terms, its promise kept over many draws, bins of poses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam.particles.kld import bins_of, count_by_kld, particles_needed

LIMITS = {"error": 0.05, "quantile": 2.326}


@pytest.mark.parametrize(("bins", "chi2"), [(2, 6.635), (11, 23.209), (51, 76.154), (101, 135.807)])
def test_the_bound_is_the_chi_square_quantile_of_the_bins_over_twice_the_error(bins, chi2):
    """Fox 2003, equation 5; 99 % quantiles of chi square with bins - 1 degrees of freedom from tables."""
    assert particles_needed(bins, **LIMITS) == pytest.approx(chi2 / (2 * 0.05), rel=0.01)


def test_a_single_bin_needs_one_particle_and_more_bins_need_more():
    needed = particles_needed(np.arange(1, 500), **LIMITS)
    assert needed[0] == 1.0
    assert np.all(np.diff(needed) > 0)


def test_the_divergence_stays_below_the_bound_as_often_as_promised():
    rng = np.random.default_rng(0)
    truth = rng.dirichlet(np.full(20, 5.0))
    count = int(np.ceil(particles_needed(20, **LIMITS)))
    seen = rng.multinomial(count, truth, size=4000) / count
    divergence = np.sum(np.where(seen > 0, seen * np.log(np.maximum(seen, 1e-300) / truth), 0.0), axis=1)
    assert 0.98 < np.mean(divergence < 0.05) <= 1.0


@given(x=st.floats(-50, 50), y=st.floats(-50, 50), theta=st.floats(-3.0, 3.0), turns=st.integers(-2, 2))
def test_whole_turns_change_no_bin(x, y, theta, turns):
    poses = np.array([(x, y, theta), (x, y, theta + 2 * np.pi * turns), (x + 0.6, y, theta)])
    bins = bins_of(poses, 0.5, 0.26)
    sector = theta / (2 * np.pi) * 24
    if abs(sector - round(sector)) > 1e-6:  # else rounding decides
        assert bins[0] == bins[1]
    assert bins[2] != bins[0]


def test_poses_of_one_bin_are_close_and_bins_fill_the_space():
    rng = np.random.default_rng(1)
    poses = rng.uniform((-3, -2, -np.pi), (3, 2, np.pi), (60_000, 3))
    bins = bins_of(poses, 0.5, np.pi / 12)
    assert len(np.unique(bins)) == 12 * 8 * 24
    for number in np.unique(bins)[::97]:
        assert np.all(np.ptp(poses[bins == number], axis=0) <= (0.5, 0.5, np.pi / 12))


def test_a_spread_belief_asks_for_more_particles_than_a_concentrated_one():
    rng, weights = np.random.default_rng(2), np.full(1000, 1e-3)
    limits = {**LIMITS, "least": 30, "most": 5000}
    assert count_by_kld(np.zeros(1000, int), weights, rng, **limits) == 30
    two = count_by_kld(np.arange(1000) % 2, weights, rng, **limits)
    assert two == pytest.approx(particles_needed(2, **LIMITS), abs=1.0)
    assert count_by_kld(np.arange(1000) % 40, weights, rng, **limits) == pytest.approx(
        particles_needed(40, **LIMITS), abs=20
    )
    assert count_by_kld(np.arange(1000), weights, rng, **limits) == 5000
    lopsided = np.where(np.arange(1000) < 2, 0.5, 0.0)
    assert count_by_kld(np.arange(1000), lopsided, rng, **limits) == two
