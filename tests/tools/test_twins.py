# SPDX-License-Identifier: MIT
"""The comparison of logs and twins: the same moments of the drive, known intervals, rows that are read back."""

from dataclasses import replace

import numpy as np
import pytest

from eval.trajectory.relations import Relations
from eval.trajectory.trajectory import Trajectory
from slam import se2
from tools.measure.twins import (
    Row,
    add_row,
    difference_of_medians,
    difference_of_rates,
    mean_error,
    nearest_rows,
    odometry_errors,
    read_rows,
    relations_at,
    table_of_runs,
    there,
)

STEPS = 400
PATH = np.stack([0.05 * np.arange(STEPS), np.zeros(STEPS), np.zeros(STEPS)], axis=1)
ROW = Row(
    study="intel-1",
    source="log",
    seed=0,
    own=0.05,
    own_by_path=0.04,
    refined=0.01,
    odometry=6.5,
    updates=100,
    matched=0.9,
    seconds=1.5,
)


def test_relations_are_those_of_the_nearest_poses_within_the_tolerance():
    path = Trajectory(0.1 * np.arange(STEPS), PATH)
    relations = relations_at(path, np.array([0.0, 1.02, 90.0]), np.array([2.0, 3.04, 91.0]), 0.05)
    assert relations.first.tolist() == pytest.approx([0.0, 1.0])
    assert relations.second.tolist() == pytest.approx([2.0, 3.0])
    assert relations.poses == pytest.approx(np.array([[1.0, 0.0, 0.0]] * 2))


def test_a_path_has_no_error_by_its_own_relations_wherever_it_lies():
    path = Trajectory(0.1 * np.arange(STEPS), PATH)
    moved = Trajectory(path.stamps, se2.compose(np.array([3.0, -1.0, 0.7]), PATH))
    relations = relations_at(path, np.array([0.0, 1.0]), np.array([2.0, 3.0]), 0.05)
    assert mean_error(moved, relations) == pytest.approx(0.0, abs=1e-9)
    longer = Trajectory(path.stamps, PATH * [1.1, 1.0, 1.0])
    assert mean_error(longer, relations) == pytest.approx(0.1)


def test_of_repeated_stamps_the_first_is_the_nearest():
    stamps = np.array([1.0, 0.5, 0.5, 2.0])
    assert nearest_rows(stamps, np.array([0.4, 0.8, 9.0])).tolist() == [1, 0, 3]


def test_relations_without_a_stamp_in_the_log_are_left_out():
    relations = Relations(np.array([0.0, 0.0]), np.array([1.0, 1.5]), np.zeros((2, 3)))
    assert there(relations, np.array([1.0, 0.0])).second.tolist() == [1.0]


def test_the_odometry_is_off_by_what_it_counts_too_much():
    """2 % of the way and 1 degree a metre, over a metre of the odometry's way."""
    assert odometry_errors(PATH, PATH, 1.0) == pytest.approx((0.0, 0.0))
    assert odometry_errors(PATH * [1.02, 1.0, 1.0], PATH, 1.02)[0] == pytest.approx(0.02, rel=0.1)
    turning = PATH.copy()
    turning[:, 2] = np.radians(PATH[:, 0])
    off = odometry_errors(turning, PATH, 1.0)
    assert off[1] == pytest.approx(1.0, rel=0.1)
    assert np.isnan(odometry_errors(PATH, PATH, 1000.0)).all()


def test_the_interval_of_rates_is_that_of_the_paper():
    """Newcombe 1998, table II, (a), method 10."""
    assert difference_of_rates(56, 70, 48, 80) == pytest.approx((0.2, 0.0524, 0.3339), abs=1e-4)
    assert difference_of_rates(0, 20, 0, 20) == pytest.approx((0.0, -0.1611, 0.1611), abs=1e-3)


def test_the_interval_of_medians_holds_the_difference():
    rng, held = np.random.default_rng(5), 0
    for _ in range(100):
        value, low, high = difference_of_medians(rng.normal(1.0, 1.0, 20), rng.normal(0.0, 2.0, 20))
        assert low <= value <= high
        held += low <= 1.0 <= high
    assert held >= 88


def test_rows_are_read_back(tmp_path):
    rows = [ROW, replace(ROW, seed=1, refined=float("nan"))]
    for row in rows:
        add_row(tmp_path / "runs.csv", row)
    first, second = read_rows(tmp_path / "runs.csv")
    assert first == ROW
    assert np.isnan(second.refined)
    assert replace(second, refined=0.0) == replace(rows[1], refined=0.0)
    assert read_rows(tmp_path / "none.csv") == []


def test_the_table_counts_failures_of_log_and_twin():
    """A mean error above 0.1 m fails on Intel; two more failures in twenty may be chance."""
    log, twin = ([0.5 if seed < failed else error for seed in range(20)] for failed, error in ((3, 0.04), (5, 0.06)))
    rows = [replace(ROW, seed=seed, own_by_path=error) for seed, error in enumerate(log)]
    rows += [replace(ROW, source="abc", seed=k, own=error, own_by_path=error) for k, error in enumerate(twin)]
    failures, errors = (
        [cell.strip() for cell in table.splitlines()[-1].strip("|").split("|")]
        for table in table_of_runs(rows).split("\n\n")
    )
    assert failures == ["intel", "1 particle", "3 of 20 (5% to 36%)", "5 of 20 (11% to 47%)", "+10 % [-15, +34]"]
    assert [cell.split(" [")[0] for cell in errors[2:6]] == ["5.0 cm", "4.0 cm", "6.0 cm", "+2.0 cm"]
