# SPDX-License-Identifier: MIT
"""Progress and plan of a job that makes datasets."""

from collections import Counter
from itertools import count

import pytest

from testbed.cli.shared import dataset_plan, dataset_progress
from testbed.cli.shared.dataset_plan import Kind, Measured, measure_some, plan_lines, split_lines, worlds_by_split
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


A, B = Kind("office", "lds01"), Kind("loop", "rplidar_a2")


def measured_of(kinds, **options):
    """The kinds that were measured, where each drive takes a second."""
    made = []

    def make(number):
        made.append(number)
        return Measured(1.0, 2.0, 3.0, 4)

    found = [kind for kind, _ in measure_some(kinds, make, **options)]
    assert len(set(made)) == len(made) == len(found)
    return found


def test_kinds_are_measured_in_turn_until_time_is_over():
    kinds = [A] * 90 + [B] * 10
    found = measured_of(kinds, clock=count(0.0, 1.0).__next__)
    assert found == [B, A] * 4
    assert len(found) == 2 + dataset_plan.MEASURING_TIME
    assert len(measured_of(kinds, clock=count(0.0, 100.0).__next__)) == 2


def test_measuring_counts_the_drives():
    """Those that are certain to be measured have a total, further ones end with the time."""
    for kinds, most in (([A] * 20 + [B], "at most 12"), ([A] * 5, "at most 5"), ([A, B], "2")):
        said = []
        found = measured_of(kinds, say=said.append, clock=count(0.0, 0.0).__next__)
        assert said == [f"measuring drive {k} of {most}" for k in range(1, len(found) + 1)]


def test_each_world_and_each_lidar_is_measured():
    kinds = [Kind(f"world-{k}", lidar) for k in range(15) for lidar in ("lds01", "rplidar_a2", "lms200")]
    found = measured_of(kinds * 4, clock=count(0.0, 100.0).__next__)
    assert {kind.world for kind in found} == {kind.world for kind in kinds}
    assert Counter(kind.lidar for kind in found) == {"lds01": 5, "rplidar_a2": 5, "lms200": 5}
    few = kinds[:6]
    assert set(measured_of(few * 4, clock=count(0.0, 100.0).__next__)) == set(few)
    one_world = [Kind("office", f"lidar-{k}") for k in range(20)]
    assert set(measured_of(one_world, clock=count(0.0, 100.0).__next__)) == set(one_world)


def test_a_plan_weights_kinds_by_how_many_there_are(tmp_path):
    measured = [(A, Measured(1.0, 100.0, 50.0, 10_000_000)), (B, Measured(3.0, 200.0, 70.0, 30_000_000))]
    (line,) = plan_lines(measured, [(A, 1.0)] * 30 + [(B, 1.0)] * 10, 2, tmp_path / "new")
    assert line.startswith("about 600 MB, 1.39 h of driving, 2.20 km; it takes about 0:00:33 with 2 workers")
    assert "not enough" in plan_lines([(A, Measured(1.0, 1.0, 1.0, 10**15))], [(A, 1.0)], 1, tmp_path)[1]


def test_a_plan_takes_length_by_world_and_size_by_lidar(tmp_path):
    measured = [(A, Measured(1.0, 100.0, 50.0, 10_000_000)), (B, Measured(4.0, 200.0, 70.0, 60_000_000))]
    (line,) = plan_lines(measured, [(Kind(A.world, B.lidar), 1.0)] * 36, 1, tmp_path)
    assert line.startswith("about 1080 MB, 1.00 h of driving, 1.80 km; it takes about 0:01:12 ")


def test_a_plan_knows_that_generated_worlds_differ_in_size(tmp_path):
    """The small ones were measured; the others have tours of thrice their length."""
    rooms = Kind("generated:rooms", "lds01")
    measured = [(rooms, Measured(1.0, 110.0, 44.0, 10_000_000, 100.0))] * 2
    (line,) = plan_lines(measured, [(rooms, 100.0)] * 5 + [(rooms, 300.0)] * 5, 1, tmp_path)
    assert line.startswith("about 200 MB, 0.61 h of driving, 0.88 km; it takes about 0:00:20 ")


@pytest.mark.parametrize(("workers", "time"), [(1, "0:00:01 with 1 worker "), (5, "0:00:01 with 1 worker ")])
def test_one_dataset_needs_one_worker(tmp_path, workers, time):
    assert f"it takes about {time}" in plan_lines([(A, Measured(1.0, 1.0, 1.0, 1))], [(A, 1.0)], workers, tmp_path)[0]


def test_a_plan_names_the_worlds_of_each_split():
    assert worlds_by_split(["office", "apartment"], {}) == {
        "train": ["apartment"],
        "validation": [],
        "test": ["office"],
    }
    names, why = split_lines(worlds_by_split(["office", "apartment"] * 3, {}), were_chosen=False)
    assert names == "train: apartment; validation: none; test: office"
    assert why.startswith("(three or more worlds give all splits; ")
    names, why = split_lines(worlds_by_split([f"rooms-{k}" for k in range(50)], {}), were_chosen=False)
    assert names.startswith("train: rooms-0, ")
    assert " more; validation: " in names
    assert "three" not in why


def test_a_plan_keeps_splits_that_were_chosen():
    chosen = {"apartment": "test", "lab": "validation"}
    names, why = split_lines(worlds_by_split(["office", "apartment"], chosen), were_chosen=True)
    assert names == "train: office; validation: none; test: apartment"
    assert why == "(as chosen before)"


def test_a_plan_says_what_was_not_measured(tmp_path):
    (line,) = plan_lines([(A, Measured(1.0, 1.0, 1.0, 1))], [(A, 1.0), (B, 1.0)], 1, tmp_path)
    assert line.endswith("not measured, estimated from the others: 1 of 2 worlds")
