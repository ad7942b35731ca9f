# SPDX-License-Identifier: MIT
"""What is said before a sweep about what it can tell."""

import pytest

from eval.sweep.job_times import duration_words
from eval.sweep.look_schedule import MAX_SEEDS_UNTIL_DECIDED, USUAL_LOOKS, level_of, looks_for
from eval.sweep.margin import MARGIN
from eval.sweep.outlook import rule_of_thumb, typical_chance, typical_outlooks
from eval.sweep.planning import foresight
from eval.sweep.statistics import min_values


@pytest.mark.parametrize("level", [0.95, 0.99])
def test_too_few_seeds_get_one_number_and_a_rule_of_thumb(level):
    few, adding, chance = foresight(3, level=level)
    assert few == "3 seeds cannot show that a count is enough; 8 can."
    assert adding.endswith("adds seeds where the answer is open, up to 40.")
    first, last = (
        "{1} to {0} %".format(*(5 * round(20 * outlook.chance(number)) for outlook in typical_outlooks(level=0.99)))
        for number in (8, 40)
    )
    assert chance.startswith(f"Chance of an answer for a world: 8 seeds about {first}, 40 about {last} (rule of ")
    assert chance.endswith("From 8 seeds on it is computed from your runs.")
    assert foresight(1, "world") == ["1 world cannot show that a count is enough; 8 can."]


def test_enough_seeds_get_their_chance_and_what_it_rests_on():
    share = typical_chance(min_values(), level=0.95, margin=MARGIN)
    assert foresight(6)[1].startswith(f"Chance of an answer for a world: {share} (rule of thumb, ")
    assert foresight(6, "world")[1].startswith(f"Chance of an answer for the kind of building: {share} (")


def test_the_smallest_difference_that_seeds_show_is_said():
    """Of a median of 10 values with standard deviations of 0.2 and 0.45 of the error, by Bloom's formula."""
    low, high = ((2.2622 + 0.8834) * share * 1.2533 / 10.0**0.5 for share in (0.2, 0.45))  # t, 9 degrees of freedom
    assert (
        foresight(10)[0]
        == f"10 seeds show a difference of {100 * low:.0f} to {100 * high:.0f} % of the error, or more."
    )


def test_an_unknown_time_is_said():
    assert duration_words(float("nan")) == "an unknown time"


def test_the_rule_of_thumb_follows_the_bound():
    """The chance with 8 seeds does not depend on it: a limit can be raised without a change to answers."""
    once, twice, usual = (rule_of_thumb(MARGIN, seeds) for seeds in (8, 16, 40))
    assert once.startswith("8 seeds about 10 to 50 % (")
    assert twice.startswith("8 seeds about 10 to 50 %, 16 about ")
    assert usual == rule_of_thumb(MARGIN)
    assert usual.startswith("8 seeds about 10 to 50 %, 40 about 65 to 90 % (rule of thumb, ")
    assert rule_of_thumb(MARGIN, 3) == once


def test_all_looks_up_to_the_usual_limit_have_one_level():
    assert len(looks_for(MAX_SEEDS_UNTIL_DECIDED)) == USUAL_LOOKS
    assert {level_of(looks_for(limit)) for limit in range(8, MAX_SEEDS_UNTIL_DECIDED + 1)} == {0.99}
    assert level_of(looks_for(80)) == 1.0 - 0.05 / 10
