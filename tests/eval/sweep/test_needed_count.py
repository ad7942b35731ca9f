# SPDX-License-Identifier: MIT
"""The model of the needed count finds the law that made its data, and knows what it does not know."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit

from eval.sweep.experiment import brier_score, joined, predict_held_out, predicted
from eval.sweep.needed_count import PREDICTORS, START, NeededCount, Runs, fit, predictors_of, shipped_model

COUNTS = np.array([1, 3, 10, 30])
HOLDING = np.array([1.0, 0.8, -1.0, -0.7, 0.5])
"""Log odds: constant, log2(particles), predictors about 0."""
GROWTH = np.array([0.6, 0.3, 0.0, 0.0])


def experiment(worlds: int, drives: int = 9, seed: int = 0, effects: tuple[float, float] = (0.0, 0.0)) -> Runs:
    """Runs whose outcomes are drawn from the law, and whose errors follow it up to noise.

    effects: standard deviations of the effects of worlds on the log odds and on the slope
    """
    rng = np.random.default_rng(seed)
    world = np.repeat(np.arange(worlds), drives * len(COUNTS))
    drive = np.repeat(np.arange(worlds * drives), len(COUNTS))
    particles = np.tile(COUNTS, worlds * drives)
    x = rng.normal(0.0, 1.5, (worlds * drives, 3))[drive]
    own = rng.standard_normal((worlds, 2))[world] * effects
    odds = HOLDING[0] + HOLDING[1] * np.log2(particles) + x @ HOLDING[2:] + own[:, 0]
    holds = rng.random(len(world)) < expit(odds)
    slope = GROWTH[0] + x @ GROWTH[1:] + own[:, 1]
    error = 0.02 * np.exp(slope * particles**-0.5 + rng.normal(0.0, 0.02, len(world)))
    return Runs(world, drive, particles, x, holds, error)


def model(holding=HOLDING, growth=GROWTH) -> NeededCount:
    """A model with these coefficients, whose worlds are all alike."""
    zero, none = np.zeros(3), np.zeros((2, 2))
    return NeededCount(
        max_count=30,
        centre=zero,
        low=zero - 3.0,
        high=zero + 3.0,
        holding=np.array([holding, holding]),
        holding_spread=none,
        growth=np.array([growth, growth]),
        growth_spread=none,
        provenance={},
    )


def test_the_fit_finds_the_law_of_its_data():
    found = fit(experiment(100), {})
    constant = found.holding[0][0] - found.centre @ found.holding[0][2:]
    np.testing.assert_allclose([constant, *found.holding[0][1:]], HOLDING, atol=0.15)
    slope = found.growth[0][0] - found.centre @ found.growth[0][1:]
    np.testing.assert_allclose([slope, *found.growth[0][1:]], GROWTH, atol=0.03)
    assert found.holding_spread[0, 0] < 0.3
    assert found.growth_spread[0, 0] < 0.02


def test_the_fit_finds_how_much_worlds_differ():
    found = fit(experiment(100, effects=(1.5, 0.4)), {})
    np.testing.assert_allclose(found.holding_spread[0, 0], 1.5, rtol=0.2)
    np.testing.assert_allclose(found.growth_spread[0], [0.4, 0.02], rtol=0.2)


def test_intervals_hold_what_another_world_needs():
    """Worlds of an experiment, and others that are predicted, are drawn from one law with effects of worlds."""
    x, effects = np.array([0.5, 0.5, 0.0]), (1.5, 0.4)
    rng, within, enough, worlds = np.random.default_rng(5), 0, 0, 25
    for seed in range(10):
        found = fit(experiment(18, seed=seed, effects=effects), {})
        low, high = (end or 31 for end in found.interval(x))
        start = found.quantile(x, START) or 31
        for odds, slope in rng.standard_normal((worlds, 2)) * effects:
            other = model(HOLDING + odds * np.eye(5)[0], GROWTH + slope * np.eye(4)[0])
            needed = other.needed(x) or 31
            within += low <= needed <= high
            enough += needed <= start
    assert within >= 0.9 * 10 * worlds  # 95 %; the draws of one experiment stand or fall together
    assert enough / (10 * worlds) >= 0.8


def test_worlds_that_differ_need_more_to_start_with():
    alike, unlike = (fit(experiment(40, effects=(own, own / 4)), {}) for own in (0.0, 2.0))
    x = np.zeros(3)
    assert unlike.start(x) > alike.start(x)
    assert unlike.chance(x, unlike.start(x)) >= START
    assert unlike.chance(x, unlike.start(x) - 1) < START
    # the middle one is known better than the next one
    middle, worlds = unlike.middle_in_draws(x), unlike.needed_in_worlds(x)
    assert np.quantile(middle, 0.9) < np.quantile(worlds, 0.9)


def test_harder_drives_need_more_particles():
    needed = [model().needed(np.array([x, 0.0, 0.0])) for x in (-3.0, -1.0, 0.0, 1.0, 2.0)]
    assert needed == sorted(needed)
    assert needed[0] < needed[-1]
    assert model().needed(np.array([9.0, 0.0, 0.0])) is None


def test_where_the_count_changes_nothing_one_particle_is_enough():
    flat = model(holding=np.array([3.0, 0.0, 0.0, 0.0, 0.0]), growth=np.zeros(4))
    assert flat.needed(np.zeros(3)) == 1


def test_the_error_decides_where_all_runs_hold():
    always = np.array([50.0, 0.0, 0.0, 0.0, 0.0])
    # exp(g (n^-1/2 - 30^-1/2)) <= 1.1 for n >= (log(1.1) / g + 30^-1/2)^-2
    for g in (0.2, 0.6, 2.0):
        expected = int(np.ceil((np.log(1.1) / g + 30**-0.5) ** -2))
        assert model(always, np.array([g, 0.0, 0.0, 0.0])).needed(np.zeros(3)) == expected


@pytest.mark.slow
def test_worlds_are_predicted_by_the_others():
    runs = experiment(12, drives=20)
    found = predict_held_out(runs, [f"world {k}" for k in range(12)])
    assert [world.place for world in found] == [f"world {k}" for k in range(12)]
    own, constant = brier_score(found)
    assert own < 0.02  # 20 drives give a share to 0.1
    assert own < 1.05 * constant
    fooled = fit(replace(runs, holds=~runs.holds), {})
    assert np.abs(predicted(fooled, runs.of(runs.world == 0), "?").predicted - found[0].predicted).max() > 0.2


@pytest.mark.slow
def test_predictions_of_held_out_worlds_are_calibrated():
    found = predict_held_out(experiment(24, drives=4, effects=(1.0, 0.4)), ["?"] * 24)
    for share in (0.8, 0.95):
        expected = [world.chance_within(share) for world in found]
        assert min(expected) >= share
        spread = np.sqrt(sum(p * (1.0 - p) for p in expected))
        assert abs(sum(world.is_within(share) for world in found) - sum(expected)) <= 3.0 * spread
    small = [world.chance_too_small for world in found]
    assert abs(sum(world.is_too_small for world in found) - sum(small)) <= 3.0 * np.sqrt(sum(small))
    sure = [replace(world, needed_predicted=np.full(2000, 1.0), start=1.0) for world in found]
    assert sum(world.is_too_small for world in sure) == sum(world.needed_observed > 1 for world in found) > 12
    assert not any(world.is_within(0.95) for world in sure if world.needed_observed > 1)


def test_a_held_out_world_has_no_say():
    runs = experiment(4)
    changed = replace(runs, holds=np.where(runs.world == 2, ~runs.holds, runs.holds))
    before, after = (predict_held_out(r, list("abcd"))[2] for r in (runs, changed))
    np.testing.assert_array_equal(before.predicted, after.predicted)
    assert (before.observed != after.observed).any()


def test_the_shipped_fit_is_whole():
    shipped = shipped_model()
    assert shipped.holding.shape[1] == 2 + len(PREDICTORS)
    assert shipped.growth.shape[1] == 1 + len(PREDICTORS)
    assert len(shipped.holding) == len(shipped.growth) > 100
    assert json.dumps(shipped.document())
    assert shipped.holding[0][1] > 0.0  # more particles hold more often
    assert {"command", "runs", "worlds", "code"} <= shipped.provenance.keys()
    assert shipped.outside(shipped.centre) == []
    assert [p.name for p in shipped.outside(shipped.high + 1.0)] == [p.name for p in PREDICTORS]


def test_features_below_the_floor_count_as_the_floor():
    features = {"longest_unknown_m": 0.0, "odometry_deg_per_m": 1.0, "scan_observability": 0.5}
    np.testing.assert_allclose(predictors_of(features), [2.0, 0.0, -1.0])


def test_parts_of_an_experiment_are_joined_by_their_complete_drives():
    first, second = experiment(3), experiment(2, seed=1)
    cut = second.of(np.arange(len(second.world) - 2))  # its last drive lacks two of its counts
    whole = joined([first, cut])
    assert len(whole.world) == len(first.world) + len(second.world) - len(COUNTS)
    assert len(np.unique(whole.world)) == 5
    assert len(np.unique(whole.drive)) == 5 * 9 - 1
    np.testing.assert_array_equal(whole.error[len(first.world) :], second.error[: -len(COUNTS)])
    assert len(predict_held_out(whole, list("abcde"))) == 5
