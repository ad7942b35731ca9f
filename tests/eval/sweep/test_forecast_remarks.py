# SPDX-License-Identifier: MIT
"""The forecast on a sweep's page: what it needs, and when the runs contradict it."""

import re

import numpy as np
import pytest

from eval.sweep.forecast_remarks import Forecast, ForecastCheck, forecast_against_runs, suggested_counts
from eval.sweep.needed_count import predictors_of, shipped_model
from eval.sweep.results import read_sweep
from eval.sweep.summary import summarise
from tests.eval.synthetic_sweep import write_sweep

FEATURES = {"longest_unknown_m": 48.0, "odometry_deg_per_m": 0.8, "scan_observability": 0.3}
"""Of a drive inside of what the experiment measured."""


def test_the_forecast_of_a_count_needs_features_and_the_default_filter(tmp_path, monkeypatch):
    assert suggested_counts(read_sweep(write_sweep(tmp_path / "a"))) == Forecast()
    monkeypatch.setattr("tests.eval.synthetic_sweep.LINES", ("default",))
    table = read_sweep(write_sweep(tmp_path / "b", about={"baseline": "default"}))
    assert suggested_counts(table) == Forecast()  # no features
    table.columns.update({f"features.{name}": np.full(table.shape, value) for name, value in FEATURES.items()})
    model = shipped_model()
    start = model.start(predictors_of(FEATURES))
    words = f"start with about {start} in hall_a and about {start} in cave; each is enough in 9 of 10 worlds like it"
    low, high = model.interval(predictors_of(FEATURES))
    assert 1 <= low < start < high
    needs = f"{low} to {high}"
    assert suggested_counts(table) == Forecast(
        f"{words}; of such worlds 95 % need {needs} in hall_a and {needs} in cave"
    )


def test_drives_unlike_those_of_the_experiment_are_told(tmp_path, monkeypatch):
    """Three of the ten drives of cave have ten times the heading error of any odometry that was tried."""
    monkeypatch.setattr("tests.eval.synthetic_sweep.LINES", ("default",))
    table = read_sweep(write_sweep(tmp_path, about={"baseline": "default"}))
    table.columns.update({f"features.{name}": np.full(table.shape, value) for name, value in FEATURES.items()})
    table.columns["features.odometry_deg_per_m"][1, ..., :3] = 80.0
    said = suggested_counts(table).unlike
    assert said.startswith("In cave 3 of the 10 drives are unlike those of the experiment in the heading error")


@pytest.fixture
def checked(tmp_path, monkeypatch):
    """How runs with 1, 25 and 30 particles agree with a forecast of up to 25; `error` of 25 in hall_a, by seed."""
    monkeypatch.setattr("tests.eval.synthetic_sweep.LINES", ("default",))
    monkeypatch.setattr("tests.eval.synthetic_sweep.COUNTS", (1, 25, 30))

    def check(error, seeds=8, with_features=True, **options):
        def errors(p, k, c, s):
            return (0.4, error(s) if p == 0 else 0.0605, 0.06)[c]

        table = read_sweep(write_sweep(tmp_path, errors, seeds=seeds, about={"baseline": "default"}, **options))
        assert 1 < shipped_model().start(predictors_of(FEATURES)) < 25
        if with_features:
            table.columns.update({f"features.{name}": np.full(table.shape, value) for name, value in FEATURES.items()})
        return forecast_against_runs(summarise(table))

    return check


def test_runs_that_are_shown_to_contradict_the_forecast_are_to_be_followed(checked):
    """With 25 the error is 1.2 cm larger in all runs, where the margin is 6 mm."""
    start = shipped_model().start(predictors_of(FEATURES))
    found = checked(lambda s: 0.072)
    assert found.shown == (
        f"The runs say otherwise: in hall_a 25 ({start} were not run) are shown to be worse than 30, by +1.20 cm "
        "[+1.20, +1.20]. Follow the runs, that is the cards: the forecast knows other worlds only."
    )
    assert found.so_far == ""
    assert checked(lambda s: 0.072, with_features=False) == ForecastCheck()
    assert checked(lambda s: 0.0605) == ForecastCheck()


def test_runs_that_show_nothing_do_not_contradict_the_forecast(checked):
    """1.2 cm are 20 % of the error: in 3 runs, in the median of 8 that differ, and in 8 that differ less."""
    beginning = r"In hall_a the error with 25 \(\d+ were not run\) is so far 20 % above that with 30 in the [a-z ]+, "

    def rest(found):
        assert found.shown == ""
        return re.sub(beginning, "", found.so_far)

    assert rest(checked(lambda s: 0.072, seeds=3)) == "but 3 seeds cannot tell."
    assert rest(checked(lambda s: 0.072 + (-0.02, -0.02, -0.01, 0.0, 0.0, 0.01, 0.02, 0.02)[s])) == (
        "which chance may explain."
    )
    assert rest(checked(lambda s: 0.072 + 0.002 * (-4, -3, -2, 0, 0, 1, 2, 3)[s])) == (
        "which is not shown to be more than the margin."
    )


def test_failures_contradict_the_forecast_too(checked):
    found = checked(lambda s: 0.0605, outcome=lambda p, k, c, s: "lost" if (p, c) == (0, 1) else "ok")
    assert "in hall_a 25 " in found.shown
    assert "are shown to fail more often than 30, in 8 of 8 runs against 0 of 8" in found.shown
