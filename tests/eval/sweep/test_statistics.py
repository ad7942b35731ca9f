# SPDX-License-Identifier: MIT
"""Intervals hold what they say: known answers, and coverage over many simulated sweeps."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from eval.sweep.statistics import (
    bootstrap_interval,
    min_values,
    minimum_detectable_effect,
    paired_difference,
    wilson_interval,
)

values = st.lists(st.floats(0.001, 100.0), min_size=2, max_size=30)


def coverage(statistic, truth: float, draw, seeds: int, sweeps: int = 600) -> float:
    """Share of simulated sweeps whose interval holds the truth."""
    rng = np.random.default_rng(0)
    return float(np.mean([bootstrap_interval(draw(rng, seeds), statistic).contains(truth) for _ in range(sweeps)]))


@pytest.mark.parametrize("seeds", [5, 10, 20])
@pytest.mark.parametrize(("statistic", "truth"), [(np.median, 1.0), (np.mean, math.exp(0.125))])
def test_intervals_of_lognormal_errors_hold_the_truth(statistic, truth, seeds):
    share = coverage(statistic, truth, lambda rng, n: rng.lognormal(0.0, 0.5, n), seeds)
    assert (0.90 if seeds > 5 else 0.86) < share < 0.99


def test_a_plain_percentile_interval_would_be_too_narrow():
    """Why the expanded one is used: of ten values the plain one holds the mean in about 90 % only."""
    rng = np.random.default_rng(1)
    plain = expanded = 0
    for _ in range(600):
        x = rng.normal(size=10)
        resampled = x[rng.integers(0, 10, (1000, 10))].mean(axis=1)
        low, high = np.quantile(resampled, [0.025, 0.975])
        plain += low <= 0.0 <= high
        expanded += bootstrap_interval(x, np.mean).contains(0.0)
    assert plain / 600 < 0.925 < expanded / 600


@settings(deadline=None)
@given(values)
def test_an_interval_holds_its_value_and_lies_within_the_data(x):
    for statistic in (np.median, np.mean):
        interval = bootstrap_interval(x, statistic)
        slack = 1e-9 * max(x)
        assert min(x) - slack <= interval.low <= interval.value + slack
        assert interval.value - slack <= interval.high <= max(x) + slack


@settings(deadline=None)
@given(values, st.floats(0.1, 10.0), st.floats(-10.0, 10.0))
def test_intervals_move_and_scale_with_the_data(x, scale, shift):
    before = bootstrap_interval(x, np.median)
    after = bootstrap_interval(scale * np.array(x) + shift, np.median)
    for name in ("value", "low", "high"):
        assert getattr(after, name) == pytest.approx(scale * getattr(before, name) + shift, abs=1e-6)


def test_equal_values_give_equal_intervals_without_nan():
    x = [3.0, 1.0, 2.0, 5.0]
    assert bootstrap_interval(x, np.mean) == bootstrap_interval([*x, math.nan], np.mean)
    nothing = bootstrap_interval([math.nan], np.mean)
    assert nothing.count == 0
    assert math.isnan(nothing.value)
    single = bootstrap_interval([2.0], np.median)
    assert (single.value, single.count) == (2.0, 1)
    assert math.isnan(single.low)


def test_the_standard_error_of_a_mean_is_the_known_one():
    x = np.random.default_rng(3).normal(size=40)
    assert bootstrap_interval(x, np.mean).standard_error == pytest.approx(x.std() / math.sqrt(40), rel=0.05)


def test_pairing_sees_an_effect_that_the_seeds_would_hide():
    rng = np.random.default_rng(4)
    seeds = rng.lognormal(0.0, 1.0, 10)
    better, worse = seeds, seeds + 0.05 + 0.01 * rng.normal(size=10)
    paired = paired_difference(worse, better)
    assert 0.03 < paired.low < 0.05 < paired.high < 0.08
    assert bootstrap_interval(worse, np.median).low < bootstrap_interval(better, np.median).high


def test_paired_differences_of_equal_runs_are_zero():
    difference = paired_difference([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    assert (difference.value, difference.low, difference.high) == (0.0, 0.0, 0.0)
    assert minimum_detectable_effect(difference) == 0.0


def test_the_detectable_effect_is_detected_with_its_power():
    """Of sweeps whose true difference it is, a t test finds about 80 %."""
    rng = np.random.default_rng(5)
    n, found, sweeps = 10, 0, 2000
    exact = (stats.t.ppf(0.975, n - 1) + stats.t.ppf(0.8, n - 1)) / math.sqrt(n)
    for _ in range(sweeps):
        found += stats.ttest_1samp(rng.normal(exact, 1.0, n), 0.0).pvalue < 0.05
    assert 0.75 < found / sweeps < 0.87
    typical = np.median(
        [minimum_detectable_effect(bootstrap_interval(rng.normal(size=n), np.mean)) for _ in range(200)]
    )
    assert typical == pytest.approx(exact, rel=0.1)
    assert math.isnan(minimum_detectable_effect(bootstrap_interval([1.0], np.mean)))


@pytest.mark.parametrize(
    ("failures", "runs", "low", "high"),
    [(0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (5, 10, 0.2366, 0.7634), (1, 20, 0.0089, 0.2361)],
)
def test_wilson_intervals_of_textbooks(failures, runs, low, high):
    assert wilson_interval(failures, runs) == pytest.approx((low, high), abs=5e-5)


@given(st.integers(1, 60), st.data())
def test_wilson_intervals_are_those_of_scipy(runs, data):
    failures = data.draw(st.integers(0, runs))
    expected = stats.binomtest(failures, runs).proportion_ci(0.95, method="wilson")
    assert wilson_interval(failures, runs) == pytest.approx((expected.low, expected.high), abs=1e-12)


@settings(deadline=None)
@given(st.integers(0, 200), st.integers(1, 200))
def test_wilson_ends_are_the_rates_that_a_score_test_just_rejects(failures, runs):
    failures = min(failures, runs)
    low, high = wilson_interval(failures, runs)
    rate, z = failures / runs, stats.norm.ppf(0.975)
    assert 0.0 <= low <= rate + 1e-12
    assert rate - 1e-12 <= high <= 1.0
    for end in (low, high):
        assert (rate - end) ** 2 == pytest.approx(z * z * end * (1.0 - end) / runs, abs=1e-12)


def test_the_rate_of_no_runs_is_unknown():
    assert all(map(math.isnan, wilson_interval(0, 0)))


@pytest.mark.parametrize("level", [0.9, 0.95, 0.99])
def test_the_fewest_values_hold_the_median_in_their_range(level):
    n = min_values(level)
    assert 1.0 - 2.0 ** (1 - n) >= level > 1.0 - 2.0 ** (2 - n)
