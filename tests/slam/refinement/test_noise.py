# SPDX-License-Identifier: MIT
"""The noise of end points about walls: variance components that are known are found again."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.refinement._noise_kernels import average_pairs
from slam.refinement.noise import INITIAL, MIN_SIGMA, Noise, estimate_noise, for_weights


def drawn(noise, seed, scans=800, surfels=60, outliers=0.0):
    """End points of scans that each see the same surfels, with deviations drawn from the noise."""
    rng = np.random.default_rng(seed)
    count = rng.integers(1, 30, size=(scans, surfels))
    surfel = np.concatenate([np.repeat(np.arange(surfels), row) for row in count])
    pair = np.repeat(np.arange(scans * surfels), count.ravel())
    ranges = np.repeat(rng.uniform(0.5, 20.0, scans * surfels), count.ravel())
    slant = np.repeat(rng.uniform(0.0, 1.4, scans * surfels), count.ravel())
    own = np.sqrt(noise.floor + ranges**2 * (noise.along * np.cos(slant) ** 2 + noise.across * np.sin(slant) ** 2))
    deviation = own * rng.normal(size=len(pair)) + np.sqrt(noise.shared) * rng.normal(size=scans * surfels)[pair]
    strange = rng.random(scans * surfels)[pair] < outliers
    deviation[strange] += rng.normal(scale=0.2, size=strange.sum())
    first = np.concatenate([[0], np.cumsum(count.sum(axis=1))])
    views = np.stack([np.cos(slant), np.sin(slant)], axis=1)
    return first, surfel.astype(np.int32), deviation, ranges, views, np.tile([1.0, 0.0], (surfels, 1))


@pytest.mark.parametrize(
    "noise",
    [
        Noise(0.01**2, 0.01**2, 0.0, 0.0),
        Noise(0.02**2, 0.0, 0.0, 0.006**2),
        Noise(0.005**2, 0.0, 0.003**2, 0.004**2),
    ],
)
@pytest.mark.parametrize("outliers", [0.0, 0.05])
def test_known_variance_components_are_found(noise, outliers):
    """The standard deviations that they predict, for means of 1 to 20 end points at 1 to 15 m, are the true ones."""
    n, r, slant = (x.ravel() for x in np.meshgrid([1, 5, 20], [1.0, 4.0, 15.0], [0.1, 0.7, 1.3]))

    def predicted(noise):
        own = noise.floor + r**2 * (noise.along * np.cos(slant) ** 2 + noise.across * np.sin(slant) ** 2)
        return np.sqrt(noise.shared + own / n)

    found = [predicted(estimate_noise(*drawn(noise, seed, outliers=outliers), INITIAL)) for seed in range(3)]
    np.testing.assert_allclose(np.mean(found, axis=0), predicted(noise), rtol=0.2)


def test_too_few_data_leave_what_was_taken_before():
    before = Noise(0.03**2, 0.02**2, 0.0, 0.0)
    few = np.array([0, 2]), np.zeros(2, np.int32), np.zeros(2), np.ones(2), np.tile([1.0, 0.0], (2, 1)), np.eye(2)[:1]
    assert estimate_noise(*few, before) == before
    none = np.array([0, 0]), np.empty(0, np.int32), np.empty(0), np.empty(0), np.empty((0, 2)), np.empty((0, 2))
    assert estimate_noise(*none, before) == before


def test_perfect_data_have_no_noise_but_count_with_the_smallest():
    first, surfel, deviation, ranges, views, normal = drawn(INITIAL, 0)
    found = estimate_noise(first, surfel, 0.0 * deviation, ranges, views, normal, INITIAL)
    assert max(found) <= 1e-7
    assert for_weights(found).floor == MIN_SIGMA**2
    assert for_weights(Noise(1.0, 0.0, 0.0, 0.0)).floor == 1.0


@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(1, 5))
@settings(deadline=None)
def test_means_are_those_of_each_scan_and_surfel(seed, scans, surfels):
    rng = np.random.default_rng(seed)
    hits = rng.integers(0, 12, size=scans)
    n, first = int(hits.sum()), np.concatenate([[0], np.cumsum(hits)])
    surfel = rng.integers(-1, surfels, size=n).astype(np.int32)
    deviation, ranges, angle, turn = rng.normal(size=n), rng.uniform(0.1, 9.0, n), rng.normal(size=n), rng.normal()
    views = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    normal = np.tile([np.cos(turn), np.sin(turn)], (surfels, 1))
    pairs = np.empty((n, 4))
    count = average_pairs(first, surfel, deviation, ranges, views, normal, pairs)
    scan = np.repeat(np.arange(scans), hits)
    expected = []
    for i in range(scans):
        for e in dict.fromkeys(surfel[(scan == i) & (surfel >= 0)].tolist()):  # in the order of their first end point
            own = (scan == i) & (surfel == e)
            squared, cosine = ranges[own] ** 2, views[own] @ normal[e]
            expected.append(
                [deviation[own].mean(), own.sum(), (squared * cosine**2).mean(), (squared * (1.0 - cosine**2)).mean()]
            )
    np.testing.assert_allclose(pairs[:count], np.reshape(expected, (-1, 4)), atol=1e-12)
