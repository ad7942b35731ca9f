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


def line_of(stamps) -> Trajectory:
    """One metre a second along x."""
    return Trajectory(np.array(stamps), np.column_stack([stamps, np.zeros(len(stamps)), np.zeros(len(stamps))]))


def test_statistics_of_pairs_are_those_of_their_definition():
    """Three pairs with known errors: 20 s apart is still short, more than half a metre has failed."""
    path = line_of([100.0, 101.0, 120.0, 120.5])
    away = np.array([[1.75, 0.0, 0.0], [20.5, 0.0, 0.0], [21.5, 0.0, np.radians(10.0)]])
    score = relation_error(path, Relations(np.full(3, 100.0), np.array([101.0, 120.0, 120.5]), away))
    np.testing.assert_allclose(score.translation_errors, [0.75, 0.5, 1.0])
    np.testing.assert_allclose(score.rotation_errors, [0.0, 0.0, 10.0])
    assert (score.short.translation.count, score.loops.translation.count) == (2, 1)
    assert score.all.failure_share == pytest.approx(2 / 3)
    assert score.all.translation_squared.mean == pytest.approx((0.5625 + 0.25 + 1.0) / 3)
    assert score.all.rotation_squared.mean == pytest.approx(100.0 / 3)
    assert (score.covered, score.unmatched, score.notes) == (1.0, 0, ())


@pytest.mark.parametrize(("off", "count"), [(0.25, 1), (0.375, 0), (-0.25, 1), (-0.375, 0)])
def test_the_nearest_stamp_within_the_tolerance_counts(off, count):
    path = line_of([0.0, 1.0, 2.0])
    at = np.array([0.0, 0.0]), np.array([2.0, 1.0 + off])
    score = relation_error(path, Relations(*at, np.array([[2.0, 0.0, 0.0], [1.0, 0.0, 0.0]])), tolerance=0.25)
    assert score.matched.tolist() == [0, 1][: 1 + count]
    assert score.unmatched == 1 - count
    np.testing.assert_allclose(score.translation_errors, 0.0)
    near_second = relation_error(
        path, Relations(np.array([0.9]), np.array([1.6]), np.array([[1.0, 0.0, 0.0]])), tolerance=0.5
    )
    np.testing.assert_allclose(near_second.translation_errors, 0.0)


@pytest.mark.parametrize(("first", "second", "covered"), [(-0.25, 2.25, True), (-0.5, 2.0, False), (0.0, 2.5, False)])
def test_relations_within_the_span_are_covered(first, second, covered):
    path = line_of([0.0, 1.0, 2.0])
    at = np.array([0.0, first]), np.array([1.0, second])
    score = relation_error(path, Relations(*at, np.ones((2, 3))), tolerance=0.25)
    assert score.covered == (1.0 if covered else 0.5)


def test_repeated_stamps_say_how_far_their_poses_are_apart():
    path = Trajectory(np.array([0.0, 1.0, 1.0, 2.0]), np.array([[0.0, 0, 0], [1.0, 0, 0], [4.0, 4.0, 0], [2.0, 0, 0]]))
    score = relation_error(path, Relations(np.zeros(1), np.ones(1), np.array([[1.0, 0.0, 0.0]])))
    assert score.notes == ("1 repeated stamps: the first pose of each counts, the others are up to 5.000 m off",)
    assert score.translation_errors.tolist() == [0.0]


def test_messages_of_relations_name_the_numbers(tmp_path):
    path = tmp_path / "pairs.relations"
    for line, expected in (
        ("0 1 0 0 0 0 0 6.3", r":1: .*got 6\.3 \(degrees\?\)"),
        ("0 1 0 0 0 0.002 0.0 0", r":1: .*got 0\.002, 0\.0"),
        ("0 1 0 0 0 0 -0.002 0", r":1: .*got 0\.0, -0\.002"),
        ("0 1 0 0 0 0 0 " + "z" * 100, rf"got '0 1 0 0 0 0 0 {'z' * 66}'"),
    ):
        path.write_text(line)
        with pytest.raises(RelationsError, match=expected):
            read_relations(path)
    path.write_text("0 1 0 0 0 0.001 -0.001 6.28\n")
    assert read_relations(path).poses[0, 2] == 6.28
    apart = Relations(np.array([10.0]), np.array([12.5]), np.zeros((1, 3)))
    with pytest.raises(RelationsError, match=r"\(10\.000000 to 12\.500000 s\).*\(0\.000000 to 2\.000000 s\) within"):
        relation_error(line_of([0.0, 1.0, 2.0]), apart)
