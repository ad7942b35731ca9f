# SPDX-License-Identifier: MIT
"""Errors of known size are measured; evo, run on the same trajectories, agrees."""

import numpy as np
import pytest

from eval.trajectory.association import associate
from eval.trajectory.errors import Statistics, absolute_error, drift, pair_errors, relative_error, stretches
from eval.trajectory.trajectory import Trajectory
from slam.se2 import compose
from tests.eval.helpers import chain, noisy, random_walk


def straight(n: int, step: float = 0.1) -> Trajectory:
    """Along x, `step` metres and 0.1 s from pose to pose."""
    return Trajectory(0.1 * np.arange(n), np.column_stack([step * np.arange(n), np.zeros(n), np.zeros(n)]))


def test_alignment_removes_a_sideways_shift():
    truth = straight(50)
    shifted = Trajectory(truth.stamps, truth.poses + np.array([0.0, 0.3, 0.0]))
    matched = associate(shifted, truth)
    assert absolute_error(matched, "none").translation == Statistics.of(np.full(50, 0.3))
    assert absolute_error(matched, "se2").translation.max < 1e-12


def test_a_path_too_long_by_one_percent_drifts_by_one_percent():
    truth = straight(1001)
    long = Trajectory(truth.stamps, truth.poses * [1.01, 1.0, 1.0])
    matched = associate(long, truth)
    found = drift(matched, [1.0, 5.0, 20.0])
    assert found.translation_percent == pytest.approx(1.0, rel=0.01)  # the last pieces are up to a tenth shorter
    assert found.rotation_deg_per_m == pytest.approx(0.0, abs=1e-9)
    assert relative_error(matched, 5.0, "m").translation.median == pytest.approx(0.05)
    assert relative_error(matched, 2.0, "s").translation.max == pytest.approx(0.02)
    assert absolute_error(matched, "first_pose").translation.max == pytest.approx(1.0)


def test_pieces_have_the_given_length():
    matched = associate(straight(101), straight(101))
    first, last = relative_error(matched, 1.0, "s").pairs
    np.testing.assert_array_equal(last - first, 10)
    assert len(first) == 91
    first, last = relative_error(matched, 1.03, "m").pairs
    np.testing.assert_array_equal((last - first)[:91], 10)
    assert len(first) == 91
    assert relative_error(matched, 11.5, "m") is None
    assert relative_error(matched, 11.5, "s") is None  # 10 s is too far off
    assert drift(matched, [50.0]) is None


def test_stretches_exist_where_poses_are_too_sparse_for_pieces():
    sparse = straight(20, step=0.7)
    matched = associate(sparse, sparse)
    assert relative_error(matched, 1.0, "m") is None
    first, last = stretches(matched, 1.0)
    np.testing.assert_array_equal(last - first, 2)
    assert len(first) == 18


def test_where_the_robot_stands_a_piece_ends_when_it_arrives():
    x = np.concatenate([np.arange(0.0, 1.05, 0.1), np.full(10, 1.0), np.arange(1.1, 2.05, 0.1)])
    waiting = Trajectory(0.1 * np.arange(len(x)), np.column_stack([x, 0.0 * x, 0.0 * x]))
    first, last = relative_error(associate(waiting, waiting), 1.0, "m").pairs
    assert (first[0], last[0]) == (0, 10)


def test_one_turned_pose_spoils_the_ate_but_few_pieces():
    motions = np.tile([0.1, 0.0, 0.0], (200, 1))
    truth = Trajectory(0.1 * np.arange(200), chain(motions))
    motions[100, 2] = np.radians(10.0)
    turned = Trajectory(truth.stamps, chain(motions))
    matched = associate(turned, truth)
    pieces = relative_error(matched, 1.0, "m")
    assert np.mean(pieces.translation.rmse) < 0.1 * absolute_error(matched, "first_pose").translation.rmse
    assert pieces.rotation.max == pytest.approx(10.0)


def test_the_relative_error_does_not_depend_on_the_frame():
    truth, estimate = random_walk(100, 4), noisy(random_walk(100, 4), 5)
    moved = Trajectory(estimate.stamps, compose([3.0, -2.0, 1.0], estimate.poses))
    a, b = (relative_error(associate(e, truth), 1.0, "m") for e in (estimate, moved))
    assert a.translation.rmse == pytest.approx(b.translation.rmse)


def to_evo(t: Trajectory):
    from evo.core.trajectory import PoseTrajectory3D

    half, zero = 0.5 * t.poses[:, 2], np.zeros(len(t))
    return PoseTrajectory3D(
        np.column_stack([t.poses[:, :2], zero]),
        np.column_stack([np.cos(half), zero, zero, np.sin(half)]),
        t.stamps.copy(),
    )


def walk_and_estimate(seed: int) -> tuple[Trajectory, Trajectory]:
    """A random path and an estimate of it with noise, in another frame."""
    truth = random_walk(300, seed)
    moved = noisy(truth, seed + 100)
    return truth, Trajectory(moved.stamps, compose([5.0, -3.0, 2.0], moved.poses))


@pytest.mark.parametrize("seed", range(5))
def test_absolute_errors_equal_evos(seed):
    metrics = pytest.importorskip("evo.core.metrics", reason="evo is in the test extra")
    truth, estimate = walk_and_estimate(seed)
    matched = associate(estimate, truth)
    for method in ("se2", "first_pose", "none"):
        ours, reference, theirs = absolute_error(matched, method), to_evo(truth), to_evo(estimate)
        if method == "se2":
            theirs.align(reference)
        elif method == "first_pose":
            theirs.align_origin(reference)
        for relation, statistics in (
            (metrics.PoseRelation.translation_part, ours.translation),
            (metrics.PoseRelation.rotation_angle_deg, ours.rotation),
        ):
            ape = metrics.APE(relation)
            ape.process_data((reference, theirs))
            compare(ape, statistics)


# 0.1 s between poses: pieces by seconds, which evo does not have, are its pieces by poses.
@pytest.mark.parametrize(
    ("delta", "unit", "evo_delta", "evo_unit"),
    [
        (1, "poses", 1, "frames"),
        (10, "poses", 10, "frames"),
        (1.0, "s", 10, "frames"),
        (5.0, "s", 50, "frames"),
        (0.3, "m", 0.3, "meters"),
        (1.0, "m", 1.0, "meters"),
        (5.0, "m", 5.0, "meters"),
        (20.0, "m", 20.0, "meters"),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_relative_errors_equal_evos_over_all_pairs(seed, delta, unit, evo_delta, evo_unit):
    metrics = pytest.importorskip("evo.core.metrics", reason="evo is in the test extra")
    truth, estimate = walk_and_estimate(seed)
    ours = relative_error(associate(estimate, truth), delta, unit)
    for relation, statistics in (
        (metrics.PoseRelation.translation_part, ours.translation),
        (metrics.PoseRelation.rotation_angle_deg, ours.rotation),
    ):
        rpe = metrics.RPE(
            relation,
            delta=evo_delta,
            delta_unit=metrics.Unit[evo_unit],
            all_pairs=True,
            pairs_from_reference=True,
        )
        rpe.process_data((to_evo(truth), to_evo(estimate)))
        assert ours.translation.count == len(rpe.error)
        compare(rpe, statistics)


@pytest.mark.parametrize("delta", [0.5, 2.0, 7.0])
def test_errors_of_evos_consecutive_pieces_are_the_same(delta):
    metrics = pytest.importorskip("evo.core.metrics", reason="evo is in the test extra")
    from evo.core.filters import filter_pairs_by_path

    truth, estimate = walk_and_estimate(7)
    rpe = metrics.RPE(metrics.PoseRelation.translation_part, delta, metrics.Unit.meters, pairs_from_reference=True)
    rpe.process_data((to_evo(truth), to_evo(estimate)))
    first, last = np.array(filter_pairs_by_path(to_evo(truth).poses_se3, delta)).T
    translation, _ = pair_errors(estimate.poses, truth.poses, (first, last))
    np.testing.assert_allclose(translation, rpe.error, atol=1e-9)


def compare(evo_metric, statistics: Statistics) -> None:
    theirs = evo_metric.get_all_statistics()
    for key, value in (
        ("rmse", statistics.rmse),
        ("mean", statistics.mean),
        ("median", statistics.median),
        ("max", statistics.max),
        ("std", statistics.std),
    ):
        assert value == pytest.approx(theirs[key], abs=1e-9), key


def test_statistics_are_those_of_their_definition():
    found = Statistics.of(np.arange(101.0))
    assert (found.mean, found.median, found.p95, found.max, found.count) == (50.0, 50.0, 95.0, 100.0, 101)
    assert found.rmse == pytest.approx(np.sqrt(3350.0))
    assert found.std == pytest.approx(np.sqrt(850.0))
    for wrong in ([], [[1.0, 2.0]]):
        with pytest.raises(ValueError, match=r"statistics take errors \(n,\) with n >= 1"):
            Statistics.of(wrong)


def test_a_heading_that_drifts_is_measured_per_metre():
    """2 degrees of error per metre; pieces of several lengths weigh as many as they are."""
    truth = straight(101)  # 10 m
    turning = Trajectory(truth.stamps, truth.poses + np.outer(np.radians(2.0) * 0.1 * np.arange(101), (0.0, 0.0, 1.0)))
    found = drift(associate(turning, truth), [1.0, 4.0])
    assert found.rotation_deg_per_m == pytest.approx(2.0, rel=0.03)
    assert found.lengths == (1.0, 4.0)


@pytest.mark.parametrize("delta", [0.0, -1.0])
def test_a_piece_has_a_length(delta):
    matched = associate(straight(101), straight(101))
    with pytest.raises(ValueError, match="must be positive"):
        relative_error(matched, delta, "m")
    assert relative_error(matched, 0.3, "s") is not None


def test_pieces_by_rows_and_by_time_whatever_the_order():
    path = straight(6)
    matched = associate(path, path)
    first, last = relative_error(matched, 2, "poses").pairs
    assert (first.tolist(), last.tolist()) == ([0, 1, 2, 3], [2, 3, 4, 5])
    assert relative_error(matched, 6, "poses") is None
    order = np.array([3, 0, 5, 1, 4, 2])
    shuffled = Trajectory(path.stamps[order], path.poses[order])
    first, last = relative_error(associate(shuffled, shuffled), 0.2, "s").pairs
    np.testing.assert_allclose(shuffled.stamps[last] - shuffled.stamps[first], 0.2)
    assert len(first) == 4


def test_stretches_of_a_round_length_are_not_one_step_too_long():
    path = straight(1001)  # sums of steps of 0.1 m are not round
    first, last = stretches(associate(path, path), 1.0)
    np.testing.assert_array_equal(last - first, 10)
    long = straight(5, step=1000.0)
    first, last = stretches(associate(long, long), 1000.0)
    np.testing.assert_array_equal(last - first, 1)


def test_drift_is_the_mean_over_all_pieces_of_all_lengths():
    """A single jump of half a metre lies in one of 20 pieces of 1 m and in two of 19 pieces of 2 m."""
    truth = straight(21, step=1.0)
    jumped = Trajectory(truth.stamps, truth.poses + np.outer(np.arange(21) > 10, (0.0, 0.5, 0.0)))
    found = drift(associate(jumped, truth), [1.0, 2.0])
    assert found.translation_percent == pytest.approx(100.0 * (1 * 0.5 / 1.0 + 2 * 0.5 / 2.0) / (20 + 19), rel=1e-9)
    assert found.rotation_deg_per_m == 0.0
    turned = Trajectory(truth.stamps, truth.poses + np.outer(np.arange(21) > 10, (0.0, 0.0, np.radians(10.0))))
    found = drift(associate(turned, truth), [1.0, 2.0])
    assert found.rotation_deg_per_m == pytest.approx((1 * 10.0 / 1.0 + 2 * 10.0 / 2.0) / (20 + 19), rel=1e-9)


def test_of_two_poses_as_near_to_the_end_of_a_piece_the_first_counts():
    path = straight(41, step=0.125)  # exact in binary
    first, last = relative_error(associate(path, path), 1.0625, "m").pairs
    np.testing.assert_array_equal((last - first)[:32], 8)


def test_by_seconds_no_piece_ends_after_the_last_pose():
    path = straight(41)
    first, last = relative_error(associate(path, path), 2.0, "s").pairs
    assert (first.tolist(), last.tolist()) == (list(range(21)), list(range(20, 41)))


def test_a_pose_just_within_the_tolerances_of_a_piece_counts():
    """Stamps that are exact: a tenth of the piece too late, and a piece that is a microsecond too long."""
    still = np.zeros((3, 3))
    late = Trajectory(np.array([-1.0, -0.5, 0.1]), still)
    first, last = relative_error(associate(late, late), 1.0, "s").pairs
    assert (first.tolist(), last.tolist()) == ([0], [2])
    round_stamps = Trajectory(np.array([0.0, 0.5, 1.0]), still)
    first, last = relative_error(associate(round_stamps, round_stamps), 1.0 + 1e-6, "s").pairs
    assert (first.tolist(), last.tolist()) == ([0], [2])


def test_stretches_of_a_long_path_are_not_one_step_too_long():
    """The sum of 100,000 steps of 0.1 m is 2e-8 m off, far more than that of a short path."""
    n = 100_001
    to_and_fro = np.zeros((n, 3))
    to_and_fro[1::2, 0] = 0.1
    path = Trajectory(np.arange(n, dtype=np.float64), to_and_fro)
    first, last = stretches(associate(path, path), 1000.0)
    np.testing.assert_array_equal(last - first, 10_000)
    assert len(first) == n - 10_000
