# SPDX-License-Identifier: MIT
"""What is said before a sweep about what it can tell holds for simulated sweeps with typical noise."""

import numpy as np
import pytest

from eval.sweep.decision import decide
from eval.sweep.planning import TYPICAL_DEVIATION, TYPICAL_ERROR, detectable_share, foresight, typical_seeds
from eval.sweep.statistics import min_values, paired_difference


def typical_sweep(rng, seeds, gain=0.0):
    """Errors (2 counts, seeds) with typical noise; the smaller count is worse by `gain`, a share of the error."""
    noise = TYPICAL_DEVIATION / np.sqrt(2.0)
    errors = TYPICAL_ERROR * (1.0 + noise * rng.normal(size=(2, seeds)))
    errors[0] += gain * TYPICAL_ERROR
    return errors


def test_as_many_seeds_as_it_says_usually_show_that_a_count_is_enough():
    rng = np.random.default_rng(0)
    seeds = typical_seeds()
    shown = [decide((1, 5), typical_sweep(rng, seeds), np.zeros((2, seeds))).kind == "enough" for _ in range(300)]
    assert 0.7 < np.mean(shown) < 0.95  # meant: 0.8


@pytest.mark.parametrize("seeds", [8, 20])
def test_the_difference_that_it_says_is_usually_seen(seeds):
    rng = np.random.default_rng(seeds)
    found = []
    for _ in range(300):
        small, large = typical_sweep(rng, seeds, gain=detectable_share(seeds))
        found.append(paired_difference(small, large).low > 0.0)
    assert 0.7 < np.mean(found) < 0.95


def test_too_few_seeds_are_warned_of():
    assert foresight(3).startswith("3 seeds cannot show that a count is enough; 6 can")
    assert foresight(1, "world").startswith("1 world cannot show")
    assert "to show that a count is enough about" in foresight(min_values())
    assert "that usually shows which count is enough" in foresight(typical_seeds())
