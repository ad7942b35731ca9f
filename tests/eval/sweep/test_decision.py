# SPDX-License-Identifier: MIT
"""Which particle count is enough: known answers, and the rate of wrong ones over many simulated sweeps."""

import math

import numpy as np

from eval.sweep.decision import decide, decide_kind_of_building
from eval.sweep.statistics import min_values

COUNTS = (1, 2, 5, 10, 20, 50)
FLAT = [0.1] * 6


def sweep(levels: list[float], noise: float, seeds: int = 10, seed: int = 0) -> np.ndarray:
    """Errors (counts, seeds) about a level for each count, half of the noise common to all counts."""
    rng = np.random.default_rng(seed)
    common = rng.normal(size=seeds)
    own = rng.normal(size=(len(levels), seeds))
    return np.array(levels)[:, None] * np.exp(noise * (common + own) / math.sqrt(2.0))


def failures(*numbers: int, seeds: int = 10) -> np.ndarray:
    """The first seeds of each count fail, (counts, seeds)."""
    return np.array([[float(s < number) for s in range(seeds)] for number in numbers])


NONE = failures(0, 0, 0, 0, 0, 0)


def test_the_count_from_which_on_more_does_not_help_is_found():
    errors = sweep([0.5, 0.2, 0.1, 0.05, 0.05, 0.05], noise=0.05)
    decision = decide(COUNTS, errors, NONE)
    assert (decision.kind, decision.count, decision.units) == ("enough", 10, 10)
    assert decision.states == ("worse", "worse", "worse", "good", "good")
    assert decision.outlook is None
    assert decide(COUNTS, errors, failures(3, 2, 1, 1, 0, 0)).count == 20  # ten lost more runs than fifty did
    assert decide(COUNTS, errors, failures(3, 2, 1, 1, 1, 1)).count == 10


def test_counts_that_still_help_ask_for_more():
    decision = decide(COUNTS, sweep([0.6, 0.5, 0.4, 0.3, 0.2, 0.1], noise=0.05), NONE)
    assert (decision.kind, decision.count) == ("more", 20)


def test_a_largest_count_that_fails_is_no_yardstick():
    decision = decide(COUNTS, sweep(FLAT, noise=0.01), failures(10, 10, 10, 10, 10, 10))
    assert (decision.kind, decision.count) == ("fails", 50)
    assert decide(COUNTS, np.full((6, 10), math.nan), failures(10, 10, 10, 10, 10, 10)).kind == "fails"


def test_many_more_failures_are_worse_whatever_the_error():
    decision = decide(COUNTS, sweep(FLAT, noise=0.01), failures(8, 5, 4, 0, 0, 0))
    assert decision.states == ("worse", "worse", "open", "good", "good")  # 4 of 10 against 0: p = 1/16


def test_too_few_seeds_give_no_answer_rather_than_a_wrong_one():
    for seeds in range(1, min_values()):
        decision = decide(COUNTS, sweep(FLAT, 0.0, seeds=seeds), failures(*[0] * 6, seeds=seeds))
        assert (decision.kind, decision.count, decision.largest_open) == ("undecided", None, 4)
        assert (decision.outlook is None) == (seeds < 2)
    seeds = min_values()
    assert decide(COUNTS, sweep(FLAT, 0.8, seeds=seeds), failures(*[0] * 6, seeds=seeds)).kind == "undecided"
    assert decide(COUNTS, sweep(FLAT, 0.05, seeds=20), failures(*[0] * 6, seeds=20)).count == 1


def test_a_higher_level_needs_more_seeds():
    errors, none = sweep(FLAT, 0.0, seeds=7), failures(*[0] * 6, seeds=7)
    assert decide(COUNTS, errors, none).kind == "enough"
    assert decide(COUNTS, errors, none, level=0.99).kind == "undecided"


def test_a_dip_at_a_small_count_is_not_taken_for_enough():
    errors = sweep([0.05, 0.5, 0.5, 0.05, 0.05, 0.05], noise=0.02)
    assert decide(COUNTS, errors, NONE).count == 10


def test_a_wrong_enough_is_rare():
    """The errors of 20 are a fifth above those of 50, twice the margin: of 200 sweeps hardly any may overlook it."""
    levels = [0.5, 0.4, 0.3, 0.2, 0.12, 0.1]
    wrong = sum(decide(COUNTS, sweep(levels, 0.3, seed=seed), NONE).kind == "enough" for seed in range(200))
    assert wrong <= 10


def test_one_count_alone_is_undecided():
    assert decide((5,), np.full((1, 10), 0.1), np.zeros((1, 10))).kind == "undecided"


def test_more_failures_keep_a_count_open_and_no_number_of_seeds_is_promised():
    errors = sweep([0.1, 0.1], noise=0.02)
    decision = decide((1, 5), errors, failures(2, 0))
    assert (decision.kind, decision.largest_open) == ("undecided", 0)
    assert decision.differences[0].high < decision.limit
    assert decision.outlook is None


def test_the_largest_open_count_is_what_the_outlook_is_about():
    errors = sweep([0.5, 0.1, 0.1, 0.1], noise=0.02)
    errors[2] += np.resize([0.03, -0.03], 10)  # noisy, so it cannot be compared
    decision = decide((1, 2, 5, 10), errors, failures(0, 0, 0, 0))
    assert decision.states == ("worse", "good", "open", "good")[:3]
    assert decision.largest_open == 2
    difference = decision.differences[2]
    assert decision.outlook.gap == decision.limit - difference.value
    assert decision.outlook.units == 10


def test_a_verdict_is_final_at_the_look_where_it_falls():
    """5 is as good as 10 in the first 8 seeds, and by much noise not shown to be in 16; 1 is decided by the others."""
    errors = np.full((3, 16), 0.1)
    errors[0] += 0.02 * (np.arange(16) % 2)  # as often equal as worse by 2 cm: open after 8 seeds
    errors[0, 8:] = 0.1
    errors[1, 8:] += 0.05
    none = np.zeros((3, 16))
    first = decide((1, 5, 10), errors[:, :8], none[:, :8], looks=(8, 16))
    assert (first.kind, first.count, first.states) == ("enough", 5, ("open", "good"))
    assert first.may_be_smaller
    assert decide((1, 5, 10), errors, none).states[1] != "good"  # looked at once
    later = decide((1, 5, 10), errors, none, looks=(8, 16))
    assert (later.kind, later.states[1], later.differences[1].count) == ("enough", "good", 8)


def test_the_limit_of_a_verdict_is_that_of_its_look():
    """After the first look the largest count's error falls to a fifth, and with it a margin that is a share of it."""
    errors = np.full((2, 20), 0.1)
    errors[0] += 0.007  # between the two margins
    errors[:, 8:] -= 0.08
    decision = decide((1, 5), errors, np.zeros((2, 20)), looks=(8, 20))
    assert (decision.kind, decision.seeds, decision.looked_at) == ("enough", (8,), 20)
    assert (decision.limits, decision.limit) == ((0.1 * 0.1,), 0.005)


def test_a_look_that_has_not_come_yet_changes_nothing():
    errors = sweep([0.3, 0.1, 0.1, 0.1, 0.1, 0.1], noise=0.02)
    assert decide(COUNTS, errors, NONE, looks=(10, 20, 40)) == decide(COUNTS, errors, NONE)


def test_the_verdict_of_a_kind_of_building_is_final_too():
    errors = np.full((8, 2, 16), 0.1)
    errors[:, 0, 8:] = 0.3
    none = np.zeros((8, 2, 16))
    assert decide_kind_of_building((1, 5), errors, none, looks=(8, 16)).kind == "enough"
    assert decide_kind_of_building((1, 5), errors, none).kind == "more"


def test_worlds_not_runs_are_the_unit_of_a_kind_of_building():
    """Runs of one world are alike: with the run as the unit differences between worlds would look certain."""
    rng = np.random.default_rng(1)
    wrong = {"worlds": 0, "runs": 0}
    for _ in range(200):
        offsets = rng.normal(0.0, 0.03, 8)[:, None] + rng.normal(0.0, 0.001, (8, 10))  # of count 1 to count 5, by world
        errors = np.stack([0.1 + 0.012 + offsets, np.full((8, 10), 0.1)], axis=1)  # truth: 0.012 above, limit 0.010
        of_worlds = decide_kind_of_building((1, 5), errors, np.zeros((8, 2, 10)))
        pooled = decide((1, 5), np.moveaxis(errors, 1, 0).reshape(2, 80), np.zeros((2, 80)))
        assert of_worlds.units == 8
        wrong["worlds"] += of_worlds.kind == "enough"
        wrong["runs"] += pooled.kind == "enough"
    assert wrong["worlds"] <= 14  # at most 2.5 % plus chance
    assert wrong["runs"] > 50


def test_each_world_counts_once_whatever_its_seeds():
    errors = np.full((7, 2, 3), 0.1)
    errors[0, 0] = [0.1, 0.1, math.nan]
    errors[1, 0] = math.nan
    decision = decide_kind_of_building((1, 5), errors, np.zeros((7, 2, 3)))
    assert (decision.kind, decision.count, decision.units) == ("enough", 1, 7)
