# SPDX-License-Identifier: MIT
"""What is said before a sweep about what it can tell."""

import pytest

from eval.sweep.job_times import duration_words
from eval.sweep.margin import MARGIN
from eval.sweep.outlook import rule_of_thumb, typical_outlook
from eval.sweep.planning import foresight
from eval.sweep.statistics import min_values


@pytest.mark.parametrize("level", [0.95, 0.99])
def test_too_few_seeds_get_one_number_and_a_rule_of_thumb(level):
    said = foresight(3, level=level)
    assert said.startswith("Too few seeds (3) to tell how many particles are enough: at least 8 are needed. ")
    outlook = typical_outlook(level=0.99)
    first, last = (5 * round(20 * outlook.chance(number)) for number in (8, 40))
    assert f"8 seeds decide a world with a chance of about {first} %, 40 with one of about {last} %" in said
    assert f"one of about {last} % (5 looks, so 99 % intervals), where a smaller count is as good as the" in said
    assert said.endswith(" With 8 seeds or more the chance is computed from your own runs.")
    assert foresight(1, "world") == ("Too few worlds (1) to tell how many particles are enough: at least 8 are needed.")


def test_enough_seeds_get_their_chance_and_what_it_rests_on():
    chance = typical_outlook(level=0.95).chance(min_values(), level=0.95)
    assert 0.05 < chance < 0.95
    share = f"about {5 * round(20 * chance)} %"
    words = f"The chance of an answer for each world is {share} where a smaller count is as good as the largest"
    assert words in foresight(6)


def test_the_smallest_difference_that_seeds_show_is_said():
    """Of a median of 10 values with a standard deviation of a quarter of the error, by Bloom's formula."""
    error = 0.25 * 1.2533 / 10.0**0.5
    smallest = (2.2622 + 0.8834) * error  # quantiles of t with 9 degrees of freedom
    assert (
        f"10 seeds show differences from about {100.0 * smallest:.0f} % of the error on in a single look."
        in foresight(10)
    )


def test_an_unknown_time_is_said():
    assert duration_words(float("nan")) == "an unknown time"


def test_the_rule_of_thumb_follows_the_bound():
    """One look with 8 seeds uses 95 % intervals and decides more often than the first of several looks."""
    once, twice, usual = (rule_of_thumb(MARGIN, seeds) for seeds in (8, 16, 40))
    assert "8 seeds decide a world with a chance of about 45 %" in once
    assert "16 with one of about" in twice
    assert usual == rule_of_thumb(MARGIN)
    assert "8 seeds decide a world with a chance of about 20 %, 40 with one of about 75 %" in usual
    assert rule_of_thumb(MARGIN, 3) == once
