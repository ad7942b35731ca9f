# SPDX-License-Identifier: MIT
"""Limits: read safely, broken when they hold, never passed for want of a number."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eval.limits import Limit, LimitError, check

METRICS = {
    "outcome": "ok",
    "trajectory": {"ate_rmse_m": 0.04, "rpe": {"5m": {"trans_rmse_m": 0.01}}, "drift_percent": None},
}


@pytest.mark.parametrize(
    ("text", "broken"),
    [
        ("trajectory.ate_rmse_m > 0.05", False),
        ("trajectory.ate_rmse_m > 0.03", True),
        ("trajectory.ate_rmse_m>=4e-2", True),
        ("trajectory.rpe.5m.trans_rmse_m < 0.01", False),
        ("  trajectory.rpe.5m.trans_rmse_m <= 0.01 ", True),
        ("outcome != ok", False),
        ("outcome == 'ok'", True),
        ("trajectory.drift_percent > 100", True),
    ],
)
def test_a_limit_is_broken_when_it_holds_or_is_not_measured(text, broken):
    sentences = check(METRICS, [Limit.parse(text)])
    assert len(sentences) == int(broken)
    if broken:
        assert text.strip() in sentences[0]


def test_a_trajectory_that_is_unjudged_breaks_every_limit_on_it():
    """Three poses, or a hundredth of the path, fit whatever the estimate is worth."""
    unjudged = METRICS | {
        "outcome": "unjudged",
        "outcome_reason": "3 matched poses",
        "map": {"iou": 0.9},
        "wall_s": 2.0,
    }
    (sentence,) = check(unjudged, [Limit.parse("trajectory.ate_rmse_m > 0.05")])
    assert sentence.endswith("the trajectory is unjudged: 3 matched poses")
    assert check(unjudged, [Limit.parse("map.iou < 0.5"), Limit.parse("wall_s > 10")]) == []


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(allow_nan=False, allow_infinity=False))
@settings(deadline=None)
def test_comparisons_are_those_of_numbers(value, bound):
    for sign, holds in (("<", value < bound), (">=", value >= bound), ("!=", value != bound)):
        assert bool(check({"x": value}, [Limit.parse(f"x {sign} {bound!r}")])) == holds


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "expected KEY COMPARISON VALUE"),
        ("trajectory.ate_rmse_m", "expected KEY COMPARISON VALUE"),
        ("__import__('os').system('true') > 1", "expected KEY COMPARISON VALUE"),
        ("map.iou < good", "expected a number"),
        ("map.iou < nan", "NaN"),
    ],
)
def test_what_is_no_limit_is_refused(text, expected):
    with pytest.raises(LimitError, match=expected):
        Limit.parse(text)


@given(st.text(max_size=40))
@settings(deadline=None)
def test_any_text_is_read_or_refused(text):
    try:
        limit = Limit.parse(text)
    except LimitError:
        return
    assert limit.comparison in text


@pytest.mark.parametrize(
    "text",
    [
        "relations.trans_mean_m > 1",
        "localization.fit < 0.5",
        "map_filter.iou < 0.5",
        "trajectory.rpe.50m.trans_rmse_m > 1",
    ],
)
def test_a_measure_that_is_missing_breaks_its_limit(text):
    (sentence,) = check(METRICS, [Limit.parse(text)])
    assert "could not be measured" in sentence


def test_an_unknown_key_is_an_error_that_names_the_nearest():
    with pytest.raises(LimitError, match=r"no trajectory\.ate_rms; near: trajectory\.ate_rmse_m"):
        check(METRICS, [Limit.parse("trajectory.ate_rms > 1")])
    with pytest.raises(LimitError, match="a group of numbers, not a number"):
        check(METRICS, [Limit.parse("trajectory.rpe > 1")])
    with pytest.raises(LimitError, match="a word, not a number"):
        check(METRICS, [Limit.parse("outcome == 1")])
