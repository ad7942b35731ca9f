# SPDX-License-Identifier: MIT
"""What is said before a sweep about what it can tell."""

from eval.sweep.job_times import duration_words, range_words
from eval.sweep.outlook import typical_outlook
from eval.sweep.planning import foresight
from eval.sweep.statistics import min_values


def test_too_few_seeds_are_warned_of_with_the_fewest_and_the_usual_number():
    usual = f"Usually {typical_outlook().words()} tell."
    assert foresight(3) == f"3 seeds cannot show that a count is enough: at least 6 are needed. {usual}"
    assert foresight(1, "world").startswith("1 world cannot show")
    assert foresight(7, level=0.99).startswith("7 seeds cannot show that a count is enough: at least 8 are needed.")


def test_enough_seeds_get_their_chance():
    chance = typical_outlook(level=0.95).chance(min_values(), level=0.95)
    assert 0.05 < chance < 0.95
    assert foresight(6).startswith(f"The chance that 6 seeds give an answer is about {5 * round(20 * chance)} %")


def test_each_number_of_seeds_stands_with_its_cost():
    said = foresight(3, seconds=lambda seeds: 60.0 * seeds)
    assert "at least 6 are needed (about 6 minutes)" in said
    outlook = typical_outlook()
    assert f"(about {outlook.low} to {outlook.high} minutes)" in said


def test_two_times_share_their_unit():
    assert range_words(840.0, 5640.0) == "about 14 to 94 minutes"
    assert range_words(50.0, 360.0) == "about 50 s to 6 minutes"
    assert duration_words(float("nan")) == "an unknown time"
    assert range_words(600.0, 610.0) == "about 10 minutes"
