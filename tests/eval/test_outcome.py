# SPDX-License-Identifier: MIT
"""Outcome labels: each rule fires on the failure it is for, and on nothing else."""

import numpy as np
import pytest

from eval.files.tum import read_tum
from eval.outcome import (
    MIN_LOOP_POSES,
    evidence_from_relations,
    evidence_from_truth,
    judge,
    loop_pairs,
)
from eval.trajectory.association import associate, covered_share
from eval.trajectory.relations import Relations, read_relations, relation_error
from eval.trajectory.trajectory import Trajectory
from slam.se2 import between, compose
from tests.eval.helpers import chain, datasets
from tests.eval.synthetic_run import drive

POSES = drive()
TRUTH = Trajectory(0.1 * np.arange(len(POSES)), POSES)
MOTIONS = np.concatenate([POSES[:1], between(POSES[:-1], POSES[1:])])


def label(motions=MOTIONS, ended=None) -> str:
    return label_of(Trajectory(TRUTH.stamps, chain(motions)), ended)


def label_of(estimate: Trajectory, ended=None) -> str:
    matched = associate(estimate, TRUTH)
    return judge(evidence_from_truth(matched, covered_share(matched, TRUTH)), ended).label


def changed(row: int, by) -> np.ndarray:
    motions = MOTIONS.copy()
    motions[row] = compose(motions[row], by)
    return motions


def test_the_truth_and_small_noise_are_ok():
    assert label() == "ok"
    rng = np.random.default_rng(0)
    assert label(MOTIONS + rng.normal(0.0, 0.0003, MOTIONS.shape)) == "ok"


def test_a_jump_of_a_metre_or_a_sudden_quarter_turn_is_lost():
    assert label(changed(400, [1.0, 0.0, 0.0])) == "lost"
    assert label(changed(400, [0.0, 0.0, np.pi / 2])) == "lost"


def test_a_small_turn_that_opens_a_loop_is_a_broken_loop():
    assert label(changed(400, [0.0, 0.0, np.radians(12.0)])) == "broken loop"


def test_one_pose_that_is_wrong_by_chance_is_not_lost():
    poses = POSES.copy()
    poses[300, :2] += 0.9
    assert label_of(Trajectory(TRUTH.stamps, poses)) == "ok"


def test_an_estimate_that_stops_or_ends_on_the_way_is_lost():
    row = 6 * len(POSES) // 10
    stopped = POSES.copy()
    stopped[row:] = stopped[row]
    assert label_of(Trajectory(TRUTH.stamps, stopped)) == "lost"
    assert label_of(TRUTH[:row]) == "lost"
    assert label_of(TRUTH[len(POSES) - row :]) == "lost"
    assert label_of(TRUTH[::7]) == "ok"  # fewer poses are no fault


def test_an_estimate_that_ends_early_is_lost_by_relations_too():
    first = np.arange(0, len(POSES) - 10, 5)
    relations = Relations(TRUTH.stamps[first], TRUTH.stamps[first + 10], between(POSES[first], POSES[first + 10]))
    for end, expected in ((len(POSES), "ok"), (6 * len(POSES) // 10, "lost")):
        error = relation_error(TRUTH[:end], relations)
        assert error.covered == pytest.approx(end / len(POSES), abs=0.02)
        assert judge(evidence_from_relations(error, relations)).label == expected
    holes = relation_error(TRUTH[np.arange(len(POSES)) % 5 == 0], relations)  # stamps that are missing in between
    assert holes.covered > 0.99


def test_a_path_that_is_stretched_by_a_few_percent_drifts():
    assert label(MOTIONS * [1.06, 1.06, 1.0]) == "drift"


@pytest.mark.parametrize("ended", ["collided", "timeout", "interrupted", "failed"])
def test_the_end_of_the_run_goes_before_everything(ended):
    assert label(ended=ended) == ended
    assert judge(None, ended).label == ended


def test_without_anything_to_judge_by_nothing_is_claimed():
    assert judge(None).label == "unjudged"
    with pytest.raises(ValueError, match="ended: expected one of"):
        judge(None, "exploded")


def test_loop_pairs_are_visits_of_one_place_with_path_between():
    first, last = loop_pairs(associate(TRUTH, TRUTH))
    assert len(first) > 100
    assert np.linalg.norm(POSES[first, :2] - POSES[last, :2], axis=1).max() <= 1.0
    assert (TRUTH.distance[last] - TRUTH.distance[first]).min() >= 10.0
    once = TRUTH[: len(POSES) // 2 - 100]
    assert len(loop_pairs(associate(once, once))[0]) == 0


def test_many_visits_are_thinned_out():
    angle = np.linspace(0.0, 2.0 * np.pi * 100, 10_000)  # 100 rounds of 31 m
    rounds = Trajectory(angle, 5.0 * np.column_stack([np.cos(angle), np.sin(angle), angle]))
    matched = associate(rounds, rounds)
    every = len(loop_pairs(matched, max_pairs=10**9)[0])
    first, last = loop_pairs(matched, max_pairs=10_000)
    assert 1_000 < len(first) <= 10_000 < 0.02 * every
    assert np.hypot(*(rounds.poses[first, :2] - rounds.poses[last, :2]).T).max() <= 1.0


def test_few_poses_are_not_thinned_out():
    standing = np.column_stack([0.3 * np.sin(np.arange(4000)), np.zeros(4000), np.zeros(4000)])
    there = Trajectory(np.arange(4000.0), standing)
    first, _ = loop_pairs(associate(there, there), max_pairs=10)
    candidates = len(np.unique(first)) + 1
    assert MIN_LOOP_POSES / 2 <= candidates < MIN_LOOP_POSES


@pytest.mark.parametrize(
    ("name", "expected"),
    [("intel_gmapping_30_seed1", "ok"), ("intel_karto", "ok"), ("intel_gmapping_5_seed1", "broken loop")],
)
def test_results_on_a_real_log_are_labelled_as_their_maps_look(name, expected):
    folder = datasets()
    path = folder.parent / "peers" / f"{name}.tum"
    if not path.exists():
        pytest.skip(f"{path} not found")
    relations = read_relations(folder / "intel" / "intel-resolved.relations")
    evidence = evidence_from_relations(relation_error(read_tum(path), relations), relations)
    assert judge(evidence).label == expected
