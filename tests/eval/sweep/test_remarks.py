# SPDX-License-Identifier: MIT
"""Sentences about real time, overconfidence and seeds."""

from eval.sweep.remarks import margin_words, overconfidence, real_time, seeds_change
from eval.sweep.results import read_sweep
from eval.sweep.summary import summarise
from tests.eval.synthetic_sweep import write_sweep


def test_the_slowest_world_says_whether_all_counts_run_in_real_time(tmp_path):
    # 10 s of driving in hall_a and 20 s in cave take 0.1 s of filter for each particle
    assert real_time(summarise(read_sweep(write_sweep(tmp_path)))) == (
        "With 1, 5, 20 particles the filter alone computes 100, 20, 5.0 times as fast as the robot drives, on one core "
        "in the slowest world: all of them in real time."
    )


def test_a_count_that_is_too_slow_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.eval.synthetic_sweep.COUNTS", (1, 50, 200))
    assert "computes 100, 2.0, 0.5 times" in (said := real_time(summarise(read_sweep(write_sweep(tmp_path)))))
    assert said.endswith(": 200 are too many for real time.")


def test_overconfidence_is_said_of_the_baseline_only(tmp_path):
    # 90 % inside for `improved`, 70 % for `motion`
    assert overconfidence(summarise(read_sweep(write_sweep(tmp_path / "a")))) == ""
    sure = summarise(read_sweep(write_sweep(tmp_path / "b", about={"baseline": "motion"})))
    assert overconfidence(sure).endswith("with 20 particles it does at 70 % (hall_a) and 70 % (cave).")


def test_what_seeds_change_is_said(tmp_path):
    fixed, random = (read_sweep(write_sweep(tmp_path / route, route=route)) for route in ("fixed", "random"))
    assert seeds_change(fixed) == "all seeds drive the same route, with other noise"
    assert seeds_change(random) == "each seed drives another route through the whole world"
    logs = read_sweep(write_sweep(tmp_path / "logs", about={"recorded": True}))
    assert seeds_change(logs) == "seeds change the random numbers of the filter only"


def test_the_margin_that_counts_is_named_where_the_worlds_differ(tmp_path):
    # 2 cm in hall_a, where 10 % are less than 5 mm; 4 cm in cave; ten times as much below
    assert margin_words(summarise(read_sweep(write_sweep(tmp_path / "a")))) == "5 mm"
    larger = write_sweep(tmp_path / "b", error=lambda p, k, c, s: (0.02, 0.4)[p])
    assert margin_words(summarise(read_sweep(larger))) == "5 mm (10 % where that is more: cave)"
    largest = write_sweep(tmp_path / "c", error=lambda p, k, c, s: 0.4)
    assert margin_words(summarise(read_sweep(largest))) == "10 %"
