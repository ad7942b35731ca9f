# SPDX-License-Identifier: MIT
"""Counts of the filter's health are those of the table of steps."""

import numpy as np
import pytest

from eval.filter.health import coalescence_spans, filter_health


def test_a_span_starts_with_the_resampling_after_coalescence():
    unique_ancestors = np.array([9, 9, 5, 2, 1, 1, 1, 6, 3, 1, 1], dtype=float)
    resampled = np.array([0, 0, 1, 1, 1, 0, 0, 1, 1, 1, 0], dtype=float)
    # 0 -> 4, and from the row before the resampling at 7 (row 6) -> 9
    np.testing.assert_array_equal(coalescence_spans(unique_ancestors, resampled), [4, 3])
    assert len(coalescence_spans(np.ones(5), np.zeros(5))) == 0


def test_health_counts_updates_only():
    steps = {
        "updated": [True, False, True, True],
        "particles": [10] * 4,
        "ess": [10.0, 1.0, 6.0, 8.0],
        "resampled": [False, True, True, False],
        "match_failures": [0, 10, 5, 1],
        "matched_share": [0.0, 0.0, 0.8, 0.6],
        "unique_ancestors": [10, 10, 4, 4],
        "loop_closed": [False, False, True, False],
    }
    found = filter_health(steps)
    assert (found.updates, found.resamplings, found.match_failures, found.loop_closures) == (3, 1, 6, 1)
    assert found.match_failure_share == pytest.approx(0.2)
    assert (found.mean_ess, found.min_ess, found.mean_ess_share) == (8.0, 6.0, pytest.approx(0.8))
    assert found.mean_matched_share == pytest.approx(0.7)
    assert (found.coalescences, found.coalescence) == (0, None)
    assert filter_health(steps | {"updated": [False] * 4}) is None
    with pytest.raises(ValueError, match="no column 'ess'"):
        filter_health({key: value for key, value in steps.items() if key != "ess"})


def test_the_largest_loop_is_the_longest_with_its_stamp():
    steps = {
        "updated": [True] * 4,
        "stamp": [5.0, 6.0, 7.0, 8.0],
        "particles": [10] * 4,
        "ess": [10.0] * 4,
        "resampled": [False] * 4,
        "match_failures": [0] * 4,
        "matched_share": [0.8] * 4,
        "unique_ancestors": [10] * 4,
        "loop_closed": [False, True, True, False],
    }
    found = filter_health(steps | {"loop_length": [0.0, 20.0, 64.0, 0.0]})
    assert (found.largest_loop_m, found.largest_loop_stamp) == (64.0, 7.0)
    for without in (steps, steps | {"loop_length": [0.0] * 4}):  # tables of older releases; no loop
        found = filter_health(without)
        assert (found.largest_loop_m, found.largest_loop_stamp) == (None, None)
