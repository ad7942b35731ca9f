# SPDX-License-Identifier: MIT
"""The relation metric: known answers, files, and the figures of an independent script on real logs."""

import numpy as np
import pytest

from eval.files.tum import read_tum
from eval.trajectory.relations import Relations, RelationsError, read_relations, relation_error
from eval.trajectory.trajectory import Trajectory
from slam.se2 import between, compose
from tests.eval.helpers import datasets, random_walk


def relations_of(truth: Trajectory, first, second) -> Relations:
    first, second = np.asarray(first), np.asarray(second)
    return Relations(truth.stamps[first], truth.stamps[second], between(truth.poses[first], truth.poses[second]))


def test_the_truth_has_no_error_in_any_frame_and_order():
    truth = random_walk(600, 1)
    relations = relations_of(truth, np.arange(0, 300), np.arange(300, 600))
    shuffled = np.random.default_rng(0).permutation(600)
    moved = Trajectory(truth.stamps[shuffled], compose([9.0, 8.0, 2.0], truth.poses[shuffled]))
    error = relation_error(moved, relations)
    assert error.all.translation.max < 1e-12
    assert error.all.rotation.max < 1e-6
    assert error.unmatched == 0


def test_an_error_known_by_hand_split_into_short_pairs_and_loops():
    truth = Trajectory(np.array([0.0, 10.0, 60.0]), np.array([[0.0, 0, 0], [1.0, 0, 0], [0.0, 0, np.pi / 2]]))
    errors = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.3, 0.4, np.radians(5.0)]])
    estimate = Trajectory(truth.stamps, truth.poses + errors)
    error = relation_error(estimate, relations_of(truth, [0, 0], [1, 2]))
    assert error.short.translation.mean == pytest.approx(0.1)
    assert error.loops.translation.mean == pytest.approx(0.5)
    assert error.loops.translation_squared.mean == pytest.approx(0.25)
    assert error.all.translation.mean == pytest.approx(0.3)
    assert error.all.translation.std == pytest.approx(0.2)
    assert error.all.rotation.mean == pytest.approx(2.5)


def test_stamps_beyond_the_tolerance_are_unmatched():
    truth = random_walk(10, 2)
    relations = relations_of(truth, [0, 1, 2], [5, 6, 7])
    late = Trajectory(np.where(np.arange(10) == 5, truth.stamps + 0.015, truth.stamps), truth.poses)
    assert relation_error(late, relations).unmatched == 1
    assert relation_error(late, relations, tolerance=0.02).unmatched == 0


def test_nothing_matched_is_an_error_not_a_zero():
    truth = random_walk(10, 3)
    with pytest.raises(RelationsError, match="none of the 1 relations"):
        relation_error(Trajectory(truth.stamps + 1e6, truth.poses), relations_of(truth, [0], [5]))


def test_repeated_stamps_are_said_and_the_first_pose_counts():
    truth = random_walk(10, 4)
    twice = Trajectory(np.r_[truth.stamps, truth.stamps], np.r_[truth.poses, truth.poses + 1.0])
    error = relation_error(twice, relations_of(truth, [0], [5]))
    assert error.all.translation.max < 1e-12
    assert "10 repeated stamps" in error.notes[0]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("1 2 3", "got 3"),
        ("1 2 3 0 0 0 0 yaw", "expected 8 numbers, got"),
        ("1 2 nan 0 0 0 0 0", "finite"),
        ("1 2 0 0 0 0 0 90", "degrees"),
        ("1 2 0 0 0 0 1.5 0", "plane"),
    ],
)
def test_a_broken_line_is_named(tmp_path, line, expected):
    path = tmp_path / "x.relations"
    path.write_text(f"# t1 t2 x y z roll pitch yaw\n1 2 0 0 0 0 0 0\n{line}\n")
    with pytest.raises(RelationsError, match=r"x\.relations:3: ") as caught:
        read_relations(path)
    assert expected in str(caught.value)


PEERS = [
    ("intel_gmapping_5_seed1", "intel/intel-resolved", "0.1810 ± 0.6741 (max 3.62)", "1.582 ± 2.605", 1345),
    ("intel_gmapping_5_seed2", "intel/intel-resolved", "0.0275 ± 0.0200 (max 0.21)", "0.955 ± 0.922", 1345),
    ("intel_gmapping_15_seed1", "intel/intel-resolved", "0.0254 ± 0.0176 (max 0.11)", "0.958 ± 0.917", 1345),
    ("intel_gmapping_30_seed1", "intel/intel-resolved", "0.0256 ± 0.0181 (max 0.13)", "0.962 ± 0.914", 1345),
    ("intel_karto", "intel/intel-resolved", "0.0181 ± 0.0120 (max 0.11)", "0.662 ± 0.734", 1345),
    ("fr079_gmapping_15_seed1", "fr079/fr079", "1.1878 ± 3.1645 (max 16.01)", "6.658 ± 12.544", 1659),
]


@pytest.mark.parametrize(("name", "relations", "translation", "rotation", "pairs"), PEERS)
def test_other_systems_score_as_by_the_independent_script(name, relations, translation, rotation, pairs):
    folder = datasets()
    estimate = folder.parent / "peers" / f"{name}.tum"
    if not estimate.exists():
        pytest.skip(f"{estimate} not found")
    error = relation_error(read_tum(estimate), read_relations(folder / f"{relations}.relations"))
    t, r = error.all.translation, error.all.rotation
    assert f"{t.mean:.4f} ± {t.std:.4f} (max {t.max:.2f})" == translation
    assert f"{r.mean:.3f} ± {r.std:.3f}" == rotation
    assert t.count == pairs
