# SPDX-License-Identifier: MIT
"""The interval of the severity that is survived holds it, whatever the system, and narrows with the runs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import binomtest

from eval.survival.threshold import LEVELS, Threshold, ThresholdSearch

TRIALS = 400


def search(fails: Callable[[float], bool], runs: int) -> Threshold:
    found = ThresholdSearch()
    for _ in range(runs):
        severity = found.next_severity
        found.add(severity, failed=fails(severity))
    return found.threshold


def logistic(threshold: float, spread: float, rng: np.random.Generator) -> Callable[[float], bool]:
    """A system that fails more and more often, half of the time at the threshold; spread 0: never below it."""
    if spread == 0.0:
        return lambda severity: severity > threshold
    return lambda severity: bool(rng.random() < 1.0 / (1.0 + np.exp(-(severity - threshold) / spread)))


@pytest.mark.parametrize("runs", [12, 30])
@pytest.mark.parametrize("spread", [0.0, 0.05, 0.15])
def test_the_interval_holds_the_threshold_in_95_of_100_trials(spread: float, runs: int) -> None:
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(TRIALS):
        threshold = rng.uniform(0.0, 1.0)
        found = search(logistic(threshold, spread, rng), runs)
        held += found.low <= threshold <= found.high
    # no coverage that is significantly below 95 %
    assert binomtest(held, TRIALS, 0.95, alternative="less").pvalue > 0.01


def test_the_value_comes_near_the_threshold_and_the_interval_narrows() -> None:
    rng = np.random.default_rng(6)
    thresholds = rng.uniform(0.1, 0.9, 60)
    few, many = (
        [search(logistic(t, 0.05, np.random.default_rng(k)), runs) for k, t in enumerate(thresholds)]
        for runs in (8, 40)
    )
    errors = [abs(found.value - t) for found, t in zip(many, thresholds, strict=True)]
    assert np.median(errors) < 0.03
    assert np.mean([f.high - f.low for f in many]) < 0.5 * np.mean([f.high - f.low for f in few])


def test_a_step_is_found_between_its_two_neighbouring_severities() -> None:
    found = search(logistic(0.62, 0.0, np.random.default_rng(0)), 30)
    assert found.value == pytest.approx(0.62, abs=1.0 / (LEVELS - 1))


def test_systems_that_survive_everything_or_nothing_lie_beyond_the_ends() -> None:
    everything, nothing = search(lambda _: False, 15), search(lambda _: True, 15)
    assert everything.value > 1.0
    assert everything.low > 0.9
    assert nothing.value < 0.0
    assert nothing.high < 0.1


def test_severities_are_levels_and_follow_from_the_runs_alone() -> None:
    ended = [(0.5, True), (0.25, False), (0.375, True), (0.3125, False)]
    first = ThresholdSearch.of(*zip(*ended, strict=True))
    assert first.next_severity == ThresholdSearch.of(*zip(*ended, strict=True)).next_severity
    assert (first.next_severity * (LEVELS - 1)).is_integer()
    assert first.threshold.runs == 4


def test_without_runs_nothing_is_known() -> None:
    found = ThresholdSearch().threshold
    assert found.low < 0.0
    assert found.high > 1.0
    assert ThresholdSearch().next_severity == 0.5
