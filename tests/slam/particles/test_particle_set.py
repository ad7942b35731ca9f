# SPDX-License-Identifier: MIT
"""Particles without their maps: which one is the most likely, before and after resampling."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.particles.particle_set import ParticleSet


def moved(particles, gains):
    n = len(particles)
    particles.move(particles.poses, np.zeros((n, 3, 3)), np.array(gains), history=particles.poses)


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
@settings(deadline=None)
def test_the_best_has_the_largest_sum_of_gains_over_its_history(seed, steps):
    rng = np.random.default_rng(seed)
    particles, sums = ParticleSet(np.zeros((6, 3))), np.zeros(6)
    for _ in range(steps):
        gains = rng.normal(scale=3.0, size=len(particles))
        moved(particles, gains)
        sums += gains
        if rng.uniform() < 0.4:
            ancestors = np.sort(rng.integers(0, len(particles), rng.integers(1, 9)))
            particles.resample(ancestors)
            sums = sums[ancestors]
        assert particles.best == np.argmax(sums)
        np.testing.assert_allclose(np.diff(particles.log_histories), np.diff(sums), atol=1e-9)


def test_right_after_resampling_the_best_is_still_the_likeliest():
    """All weights are equal then; number 0 is not the one."""
    particles = ParticleSet(np.zeros((3, 3)))
    moved(particles, [0.0, 5.0, 1.0])
    particles.resample(np.array([2, 1, 1]))
    assert np.ptp(particles.weights.values) == 0.0
    assert particles.best == 1


def test_a_particle_without_gain_is_never_the_best_again():
    particles = ParticleSet(np.zeros((3, 3)))
    moved(particles, [3.0, 0.0, -1.0])
    moved(particles, [np.nan, 0.0, 0.0])
    moved(particles, [9.0, 0.0, 0.0])
    assert particles.best == 1
    moved(particles, [np.nan, np.nan, np.nan])  # such a scan says nothing
    assert particles.best == 1


def test_offspring_go_on_with_the_errors_of_their_ancestors():
    particles = ParticleSet(np.zeros((3, 3)))
    particles.errors = np.arange(9.0).reshape(3, 3)
    particles.resample(np.array([2, 0, 0, 1]))
    assert particles.errors[:, 0].tolist() == [6.0, 0.0, 0.0, 3.0]
