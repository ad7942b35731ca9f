# SPDX-License-Identifier: MIT
"""Sentences about real time, overconfidence and seeds."""

from dataclasses import replace

import numpy as np

from eval.sweep.answers import answers
from eval.sweep.remarks import (
    after_final_pass,
    look_rule,
    margin_words,
    never_resampled,
    overconfidence,
    real_time,
    seeds_change,
)
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
    assert overconfidence(sure).endswith("it does at 70 % (hall_a, 20 particles) and 70 % (cave, 20 particles).")
    same = write_sweep(tmp_path / "c", error=lambda p, k, c, s: 0.02, about={"baseline": "motion"})
    said = overconfidence(summarise(read_sweep(same)))
    assert said.endswith("it does at 70 % (hall_a, 1 particle) and 70 % (cave, 1 particle).")


def test_a_world_with_an_honest_filter_is_not_overconfident(tmp_path):
    table = read_sweep(write_sweep(tmp_path, about={"baseline": "motion"}))
    table.columns["filter.consistency.inside_share"][0] = 0.95  # hall_a
    said = overconfidence(summarise(table))
    assert said.startswith("The filter is overconfident in cave: ")
    assert said.endswith("it does at 70 % (cave, 20 particles).")


def test_a_world_that_the_user_gave_up_is_not_said_to_be_hopeless(tmp_path):
    def noisy(p, k, c, s):
        return 0.02 + 0.001 * (0.0, 6.0 * ((5 * s) % 8 - 3.5) / 3.5, 0.0)[c]

    missing = frozenset((p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(8, 40))
    facts = {"level": 0.99, "give_up": ["hall_a"]}
    write_sweep(tmp_path, error=noisy, seeds=40, missing=missing, about=facts)
    summary = summarise(read_sweep(tmp_path).judged())
    left, other = answers(summary, "improved")
    assert left.needs.startswith(
        "you gave this world up after 8 seeds (--give-up none takes it up again); with 40 seeds"
    )
    assert "you gave" not in other.needs
    assert look_rule(summary.table).endswith(
        "By the user's decision, not by the rule, no more seeds were added in hall_a after 8 seeds."
    )


def test_what_seeds_change_is_said(tmp_path):
    fixed, random = (read_sweep(write_sweep(tmp_path / route, route=route)) for route in ("fixed", "random"))
    assert seeds_change(fixed) == "all seeds drive the same route, with other noise"
    assert seeds_change(random) == "each seed drives another route through the whole world"
    ran = random.ran
    lengths = np.where(ran, 30.0, np.nan)
    lengths[0] *= 0.5
    features = {"features.route_m": np.where(ran, 60.0, np.nan)}
    cut = replace(random, columns=random.columns | features | {"trajectory_filter.length_m": lengths})
    assert seeds_change(cut) == "each seed drives the first 25 to 50 % of another route through the whole world"
    assert answers(summarise(cut), "improved")[0].name == "hall_a, 10 routes, cut short"
    whole = replace(cut, columns=cut.columns | {"trajectory_filter.length_m": np.where(ran, 59.0, np.nan)})
    assert seeds_change(whole) == seeds_change(random)
    logs = read_sweep(write_sweep(tmp_path / "logs", about={"recorded": True}))
    assert seeds_change(logs) == "seeds change the random numbers of the filter only"


def test_drives_on_which_particles_are_never_selected_are_named(tmp_path):
    table = read_sweep(write_sweep(tmp_path))
    assert never_resampled(summarise(table)) == ""  # unknown
    counts = np.full(table.shape, 3.0)
    counts[1, 0, -1, :9] = 0.0  # cave, improved, the largest count
    counts[0, 1] = 0.0  # another line
    counts[:, :, 0] = 0.0  # another count
    table = replace(table, columns=table.columns | {"filter.resamplings": counts})
    said = never_resampled(summarise(table))
    assert said.startswith("runs with 20 particles that never resampled: 9 of 10 in cave. ")
    assert "hall_a" not in said
    hall, cave = answers(summarise(table), "improved")
    assert cave.caution == "9 of 10 runs with 20 never resampled: these drives ask little of the count"
    assert hall.caution == ""
    assert (hall.kind, hall.mark) == (cave.kind, "good")
    assert cave.mark == "fair"
    counts[1, 0, -1, 4:] = 1.0
    assert never_resampled(summarise(table)) == ""


def test_the_margin_that_counts_is_named_where_the_worlds_differ(tmp_path):
    # 2 cm in hall_a, where 10 % are less than 5 mm; 4 cm in cave; ten times as much below
    assert (
        margin_words(summarise(read_sweep(write_sweep(tmp_path / "a"))))
        == "5 mm (hall_a 25 %, cave 13 % of the error with 20)"
    )
    larger = write_sweep(tmp_path / "b", error=lambda p, k, c, s: (0.02, 0.4)[p])
    assert margin_words(summarise(read_sweep(larger))) == (
        "5 mm (10 % where that is more; hall_a 25 %, cave 10 % of the error with 20)"
    )
    largest = write_sweep(tmp_path / "c", error=lambda p, k, c, s: 0.4)
    assert margin_words(summarise(read_sweep(largest))) == "10 %"


def test_the_final_pass_is_said_with_what_it_leaves(tmp_path):
    """In the tables it divides every error by five."""
    equal = write_sweep(tmp_path / "a", error=lambda p, k, c, s: 0.05 if c == 0 else 0.03 + 0.02 * p)
    assert after_final_pass(summarise(read_sweep(equal))) == (
        "the smallest count does as well within the margin: hall_a 1.0 cm with 1 particle, 0.60 with 20 (paired "
        "difference +0.40 cm [+0.40, +0.40]); cave 1.0 cm with 1 particle, 1.0 with 20 (paired difference +0.00 cm "
        "[+0.00, +0.00]); 95 % intervals."
    )
    worse = write_sweep(tmp_path / "b", error=lambda p, k, c, s: 0.3 if (p, c) == (0, 0) else 0.03)
    assert after_final_pass(summarise(read_sweep(worse))).startswith("the count still matters in hall_a: hall_a 6.0 cm")
    few = write_sweep(tmp_path / "few", error=lambda p, k, c, s: 0.03, seeds=3)
    said = after_final_pass(summarise(read_sweep(few)))
    assert said.startswith("it is not shown whether the count still matters: hall_a 0.60 cm")
    own = write_sweep(tmp_path / "c", measure="trajectory_online.ate_rmse_m")
    assert after_final_pass(summarise(read_sweep(own))) == ""


def test_the_rule_of_looks_says_where_each_world_stands(tmp_path):
    assert look_rule(read_sweep(write_sweep(tmp_path / "a"))) == ""
    later = frozenset((1, k, c, s) for k in range(2) for c in range(3) for s in range(8, 40))
    done = frozenset((0, k, c, s) for k in range(2) for c in range(3) for s in range(16, 40))
    table = read_sweep(write_sweep(tmp_path / "b", seeds=40, missing=later | done, about={"level": 0.99})).judged()
    assert look_rule(table) == (
        "The results are looked at up to 5 times (after 8, 16, 24, 32 and 40 seeds), with 99 % intervals, so that the "
        "answers of up to 5 looks at a world together hold with 95 % confidence (Bonferroni); the verdict on a count "
        "is final at the look where it falls. "
        "A world gets no more seeds once it has an answer, or where the chance of that is below 10 %. "
        "hall_a is at look 2 (16 seeds), cave is at look 1 (8 seeds), of at most 40 seeds."
    )
