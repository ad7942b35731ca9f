# SPDX-License-Identifier: MIT
"""Weights: normalised, bounded, and defined whatever the gains are."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam.particles.weights import Weights, pose_covariance

GAINS = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=30)


@given(GAINS)
@settings(deadline=None)
def test_weights_are_the_normalised_exponentials(gains):
    gains = np.array(gains)
    weights, evidence = Weights.uniform(len(gains)).times(gains)
    expected = np.exp(gains - gains.max())
    np.testing.assert_allclose(weights.values, expected / expected.sum(), atol=1e-12)
    assert evidence == pytest.approx(gains.max() + math.log(expected.mean()), rel=1e-9, abs=1e-9)


@given(GAINS, st.floats(-1e5, 1e5))
@settings(deadline=None)
def test_a_common_factor_changes_the_evidence_alone(gains, shift):
    gains = np.array(gains)
    plain, shifted = (Weights.uniform(len(gains)).times(gains + c) for c in (0.0, shift))
    np.testing.assert_allclose(shifted[0].values, plain[0].values, atol=1e-8)
    assert shifted[1] - plain[1] == pytest.approx(shift, abs=1e-8)


@given(GAINS)
@settings(deadline=None)
def test_gains_one_after_the_other_multiply(gains):
    gains = np.array(gains)
    start = Weights.uniform(len(gains))
    once, evidence = start.times(gains)
    half, first = start.times(0.5 * gains)
    twice, second = half.times(0.5 * gains)
    np.testing.assert_allclose(twice.values, once.values, atol=1e-8)
    assert first + second == pytest.approx(evidence, rel=1e-9, abs=1e-8)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=1, max_size=30))
@settings(deadline=None)
def test_whatever_the_gains_weights_stay_weights(gains):
    weights, evidence = Weights.uniform(len(gains)).times(np.array(gains))
    assert weights.values.sum() == pytest.approx(1.0)
    assert np.all(weights.values >= 0.0)
    assert 1.0 - 1e-9 <= weights.ess <= len(gains) * (1.0 + 1e-9)
    assert not math.isnan(evidence)


def test_a_particle_of_no_gain_loses_its_weight_to_the_others():
    weights, _ = Weights.uniform(3).times(np.array([0.0, math.nan, -math.inf]))
    np.testing.assert_allclose(weights.values, [1.0, 0.0, 0.0])
    assert weights.ess == pytest.approx(1.0)


def test_weights_far_below_the_smallest_float_keep_their_ratio():
    weights, evidence = Weights.uniform(2).times(np.array([-1e5, -1e5 + math.log(3.0)]))
    np.testing.assert_allclose(weights.values, [0.25, 0.75])
    assert evidence == pytest.approx(-1e5 + math.log(2.0))


@pytest.mark.parametrize("gain", [-math.inf, math.nan])
def test_where_nobody_has_a_gain_all_stays_as_it_was(gain):
    before, _ = Weights.uniform(3).times(np.log([0.2, 0.3, 0.5]))
    after, evidence = before.times(np.full(3, gain))
    np.testing.assert_array_equal(after.values, before.values)
    assert evidence == -math.inf


def test_effective_sample_size_of_k_equal_weights_is_k():
    gains = np.where(np.arange(10) < 4, 0.0, -np.inf)
    assert Weights.uniform(10).times(gains)[0].ess == pytest.approx(4.0)


def test_values_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        Weights.uniform(3).values[0] = 1.0


@given(st.integers(1, 8), st.integers(0, 2**32 - 1), st.floats(-7.0, 7.0))
@settings(deadline=None)
def test_the_covariance_of_a_mixture_is_within_plus_between(count, seed, heading):
    """Headings on both sides of half a turn are near each other."""
    rng = np.random.default_rng(seed)
    poses = rng.normal(size=(count, 3)) * (2.0, 1.0, 0.4) + (5.0, -3.0, heading)
    factors = rng.normal(size=(count, 3, 3))
    spread = factors @ factors.transpose(0, 2, 1)
    weights = rng.dirichlet(np.ones(count))
    expected = np.einsum("i,iab->ab", weights, spread) + np.cov(poses.T, aweights=weights, ddof=0).reshape(3, 3)
    turned = poses + np.outer(rng.integers(-1, 2, count), (0.0, 0.0, 2.0 * np.pi))
    np.testing.assert_allclose(pose_covariance(turned, weights, spread), expected, atol=1e-9)


@pytest.mark.parametrize("heading", [-math.pi, -0.5 * math.pi, 0.0, 0.5 * math.pi, math.pi])
def test_headings_are_compared_the_short_way_round(heading):
    """A quarter of the weight 0.3 rad to the left of the rest: variance 0.25 * 0.75 * 0.3^2."""
    poses = np.array([[1.0, 2.0, heading - 0.1], [1.0, 2.0, heading + 0.2]])
    poses[:, 2] = (poses[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
    found = pose_covariance(poses, np.array([0.75, 0.25]), np.zeros((2, 3, 3)))
    np.testing.assert_allclose(found, np.diag([0.0, 0.0, 0.25 * 0.75 * 0.09]), atol=1e-12)


@pytest.mark.parametrize("middle", [0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi])
@pytest.mark.parametrize(
    ("offsets", "weights"),
    [((-0.05, 0.05), (0.5, 0.5)), ((0.001, -2.0), (0.1, 0.9)), ((-0.001, 2.0), (0.1, 0.9))],
    ids=["narrow", "to the right", "to the left"],
)
def test_headings_scatter_alike_about_all_directions(middle, offsets, weights):
    """Wherever headings are cut, from pi to -pi or elsewhere, none of two that are less than half a turn apart is."""
    headings, shares = np.array(offsets), np.array(weights)
    expected = shares @ (headings - shares @ headings) ** 2
    poses = np.column_stack([np.zeros((2, 2)), (headings + middle + np.pi) % (2.0 * np.pi) - np.pi])
    found = pose_covariance(poses, shares, np.zeros((2, 3, 3)))
    np.testing.assert_allclose(found[2, 2], expected, rtol=1e-9)
