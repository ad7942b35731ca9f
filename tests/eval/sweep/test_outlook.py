# SPDX-License-Identifier: MIT
"""How many seeds would tell: the chance that is stated is the share of simulated sweeps that get an answer."""

import math

import numpy as np
import pytest
from scipy.special import stdtrit

from eval.sweep.decision import decide
from eval.sweep.outlook import Outlook, bound_for, chance_sentence, chance_words, outlook_of, typical_outlooks
from eval.sweep.statistics import min_values, paired_difference

LIMIT = 0.005


def differences(rng, seeds, mean, deviation=0.006):
    return mean + deviation * rng.normal(size=seeds)


@pytest.mark.parametrize(("now", "later"), [(3, 16), (8, 24), (16, 40)])
def test_the_stated_chance_is_the_share_of_sweeps_that_get_an_answer(now, later):
    """Over sweeps whose true difference varies widely, as the estimate assumes."""
    rng = np.random.default_rng(now)
    stated, found = [], []
    for _ in range(400):
        values = differences(rng, later, rng.uniform(-0.02, 0.03))
        errors = np.vstack([0.05 + values, np.full(later, 0.05)])
        none = np.zeros((2, later))
        if decide((1, 5), errors[:, :now], none[:, :now], level=0.99).kind != "undecided":
            continue
        outlook = outlook_of(paired_difference(values[:now], np.zeros(now)), LIMIT, level=0.99)
        stated.append(outlook.chance(later))
        found.append(decide((1, 5), errors, none, level=0.99).kind != "undecided")
    assert len(found) > 60
    assert np.mean(stated) == pytest.approx(np.mean(found), abs=0.12)


def simulated_chance(outlook, units, draws=40_000):
    """The chance by drawing variance, true difference and further seeds, one after the other."""
    rng, n = np.random.default_rng(0), outlook.units
    sigma = outlook.deviation * np.sqrt((n - 1) / rng.chisquare(n - 1, draws))
    true = outlook.gap + sigma * rng.normal(size=draws) / math.sqrt(n)
    added = units - n if outlook.is_measured else units
    further = true + sigma * rng.normal(size=draws) / math.sqrt(added)
    final = (n * outlook.gap + added * further) / units if outlook.is_measured else further
    return np.mean(np.abs(final) > stdtrit(units - 1, 0.5 + 0.5 * outlook.level) * sigma / math.sqrt(units))


@pytest.mark.parametrize("is_measured", [True, False])
@pytest.mark.parametrize(("gap", "units", "later"), [(0.004, 8, 24), (0.001, 8, 40), (0.006, 3, 16), (0.002, 20, 100)])
def test_the_chance_is_that_of_drawing_step_by_step(gap, units, later, is_measured):
    outlook = Outlook(gap, 0.008, units, is_measured=is_measured)
    assert outlook.chance(later) == pytest.approx(simulated_chance(outlook, later), abs=0.015)


def test_few_seeds_give_a_wide_range_and_many_a_narrow_one():
    few, many = (Outlook(0.004, 0.008, units) for units in (3, 30))
    assert few.high / few.low > 10.0
    assert many.high / many.low < 2.0


def test_the_range_never_begins_below_what_can_decide_or_is_there():
    easy = Outlook(1.0, 1e-6, 2)
    assert easy.low == easy.high == min_values(0.99)
    assert Outlook(1.0, 1e-6, 30).low == 31
    assert easy.chance(7) == 0.0
    assert Outlook(1.0, 1e-6, 30).chance(30) == 0.0


def test_a_difference_at_the_limit_cannot_be_decided():
    outlook = outlook_of(paired_difference(LIMIT + np.resize([0.001, -0.001], 100), np.zeros(100)), LIMIT, level=0.99)
    assert outlook.chance(200) < 0.05
    said = chance_sentence(outlook, [200], "5 are enough")  # which is no likely answer
    assert said == "with 200 seeds the chance of any answer is under 5 %"


def test_a_chance_that_is_shown_as_80_percent_needs_no_further_seeds():
    """Rounded to 5 %, 78 % reads as 80 %."""
    said = [chance_sentence(Outlook(0.001 * gap / 40.0, 0.005, 20), [40], "") for gap in range(20, 160)]
    shown = [text for text in said if "about 80 %" in text]
    assert shown
    assert not any("for 80 %" in text for text in shown)


def test_no_noise_and_no_data_are_no_errors():
    assert Outlook(0.004, 0.0, 9).chance(10) == 1.0
    assert Outlook(0.0, 0.0, 9).chance(10) == 0.0
    for values in ([], [0.001]):
        assert outlook_of(paired_difference(values, np.zeros(len(values))), LIMIT, level=0.95) is None
    assert outlook_of(paired_difference([0.1, 0.2], np.zeros(2)), math.nan, level=0.95) is None


def test_more_seeds_and_a_lower_level_raise_the_chance():
    outlook, _ = typical_outlooks()
    chances = [outlook.chance(n) for n in range(8, 60)]
    assert chances == sorted(chances)
    assert outlook.chance(20, level=0.95) > outlook.chance(20)


def test_numbers_are_no_finer_than_they_are_known():
    assert [chance_words(c) for c in (0.01, 0.23, 0.77, 0.99)] == ["under 5 %", "about 25 %", "about 75 %", "over 95 %"]


def test_the_look_that_probably_answers_is_named_and_no_other_number():
    """A number of seeds between two looks cannot be had."""
    soon = Outlook(0.006, 0.005, 9)
    assert 9 < soon.high < 16
    assert chance_sentence(soon, [16, 24, 32, 40], "more than 5") == (
        "with 16 seeds the chance of any answer is about 90 % (most likely: more than 5)"
    )
    assert bound_for(soon) == 16
    late = Outlook(0.002, 0.005, 30)
    assert 48 < late.high <= 200
    assert bound_for(late) - 8 < late.high <= bound_for(late)
    said = chance_sentence(late, [32, 40], "1 is enough", "world")
    assert said == (
        f"with 40 worlds the chance of any answer is {chance_words(late.chance(40))}; "
        f"for 80 % about {bound_for(late)} are needed"
    )
    never = Outlook(0.0001, 0.01, 9)
    assert chance_sentence(never, [16, 40], "").endswith("for 80 % more than 200 are needed (a rough guess from 9)")
