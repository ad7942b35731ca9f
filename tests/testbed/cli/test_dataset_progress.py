# SPDX-License-Identifier: MIT
"""Progress and plan of a job that makes datasets."""

from itertools import count

import pytest

from testbed.cli.shared import dataset_plan, dataset_progress
from testbed.cli.shared.dataset_plan import Measured, measure_some, plan_lines, split_line
from testbed.cli.shared.dataset_progress import DatasetProgress


def test_the_start_of_the_workers_does_not_count(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(dataset_progress.time, "monotonic", lambda: now[0])
    progress = DatasetProgress(10)
    progress.stage("starting 2 workers")
    now[0] = 4.2
    assert progress.line() == "0 of 10 datasets, starting 2 workers (4 s)"
    for now[0] in (100.0, 101.0, 102.0):
        progress.done("office-0003", 60.0, 5_000_000)
    assert progress.line() == (
        "3 of 10 datasets, 15 MB, 60 simulated s per s, 0:00:07 left, last finished: office-0003"
    )
    progress.stage("writing index")
    assert progress.line() == "3 of 10 datasets, 15 MB, writing index (0 s)"


def test_kinds_are_measured_in_turn_until_time_is_over():
    kinds = ["a"] * 90 + ["b"] * 10
    made = []

    def make(number):
        made.append(number)
        return Measured(1.0, 2.0, 3.0, 4)

    found = measure_some(kinds, make, clock=count(0.0, 1.0).__next__)
    assert [kind for kind, _ in found] == ["a", "b"] * 4
    assert len(set(made)) == len(made) == 2 + dataset_plan.MEASURING_TIME
    assert len(measure_some(kinds, make, clock=count(0.0, 100.0).__next__)) == 2


def test_a_plan_weights_kinds_by_how_many_there_are(tmp_path):
    measured = [("a", Measured(1.0, 100.0, 50.0, 10_000_000)), ("b", Measured(3.0, 200.0, 70.0, 30_000_000))]
    line, free = plan_lines(measured, ["a"] * 30 + ["b"] * 10, 2, tmp_path / "new")
    assert line.startswith("about 600 MB, 1.39 h of driving, 2.20 km; it takes about 0:00:33 with 2 workers")
    assert free.startswith("free on this disk: ")
    assert "not enough" in plan_lines([("a", Measured(1.0, 1.0, 1.0, 10**15))], ["a"], 1, tmp_path)[1]


@pytest.mark.parametrize(("workers", "time"), [(1, "0:00:01 with 1 worker "), (5, "0:00:01 with 1 worker ")])
def test_one_dataset_needs_one_worker(tmp_path, workers, time):
    assert f"it takes about {time}" in plan_lines([("a", Measured(1.0, 1.0, 1.0, 1))], ["a"], workers, tmp_path)[0]


def test_a_plan_names_the_worlds_of_each_split():
    assert split_line(["office", "apartment"] * 3) == (
        "train: apartment; validation: none; test: office; three or more worlds give all splits"
    )
    assert split_line([f"rooms-{k}" for k in range(50)]).startswith("train: rooms-0, ")
    assert " more; validation: " in split_line([f"rooms-{k}" for k in range(50)])


def test_a_plan_says_what_was_not_measured(tmp_path):
    (line, _) = plan_lines([("a", Measured(1.0, 1.0, 1.0, 1))], ["a", "b"], 1, tmp_path)
    assert line.endswith("not measured, taken as the mean of the others: 1 of 2 kinds")
