# SPDX-License-Identifier: MIT
"""Poses are matched by time: exactly, by interpolation, in any order; no common time is an error."""

import numpy as np
import pytest

from eval.trajectory.association import AssociationError, associate, covered_share
from eval.trajectory.errors import relative_error
from eval.trajectory.trajectory import Trajectory
from slam.se2 import wrap_angle
from tests.eval.helpers import noisy, random_walk


def straight(n: int, step: float = 0.1) -> Trajectory:
    """Along x, `step` metres and 0.1 s from pose to pose."""
    return Trajectory(0.1 * np.arange(n), np.column_stack([step * np.arange(n), np.zeros(n), np.zeros(n)]))


def test_identical_stamps_are_matched_row_by_row():
    stamps = np.array([1.0, 3.0, 2.0, 2.0])
    a = Trajectory(stamps, np.arange(12.0).reshape(4, 3))
    b = Trajectory(stamps, -np.arange(12.0).reshape(4, 3))
    matched = associate(a, b)
    np.testing.assert_array_equal(matched.reference.poses, b.poses)
    assert matched.share == 1.0


def test_interpolation_is_exact_and_takes_the_shorter_turn():
    reference = Trajectory(np.array([0.0, 0.4]), np.array([[0.0, 0.0, 3.0], [4.0, 2.0, -3.0]]))
    matched = associate(Trajectory(np.array([0.1]), np.zeros((1, 3))), reference)
    np.testing.assert_allclose(matched.reference.poses[0, :2], [1.0, 0.5])
    assert wrap_angle(matched.reference.poses[0, 2]) == pytest.approx(3.0 + (2 * np.pi - 6.0) / 4.0)


def test_no_pose_is_made_up_in_a_gap_and_the_share_says_so():
    reference = Trajectory(np.array([0.0, 10.0]), np.zeros((2, 3)))
    matched = associate(Trajectory(np.array([0.005, 5.0, 9.995, 12.0]), np.zeros((4, 3))), reference)
    np.testing.assert_array_equal(matched.rows, [0, 2])
    assert matched.share == 0.5
    assert "2 of 4 poses have no partner" in matched.notes[0]


def test_an_unsorted_estimate_is_sorted_and_keeps_its_errors():
    truth = random_walk(200, 6)
    estimate = noisy(truth, 7)
    shuffled = np.random.default_rng(0).permutation(200)
    matched = associate(estimate[shuffled], truth)
    np.testing.assert_array_equal(shuffled[matched.rows], np.arange(200))
    assert "step back" in matched.notes[0]
    straight_on = associate(estimate, truth)
    a, b = (relative_error(found, 1.0, "m").translation for found in (matched, straight_on))
    assert a.rmse == pytest.approx(b.rmse, abs=1e-12)
    assert a.count == b.count
    twice = Trajectory(np.r_[truth.stamps, truth.stamps[-1]], np.r_[truth.poses, truth.poses[-1:]])
    assert "1 repeated stamps in the estimate" in associate(twice, truth).notes[0]


def test_the_covered_share_does_not_depend_on_the_density():
    truth = straight(101)
    for rows, share in ((slice(0, 101, 10), 1.0), (slice(0, 51), 0.5), (slice(25, 76), 0.5)):
        assert covered_share(associate(truth[rows], truth), truth) == pytest.approx(share)
    assert associate(truth[:51], truth).share == 1.0


def test_the_first_of_repeated_reference_stamps_counts():
    reference = Trajectory(np.array([2.0, 1.0, 1.0]), np.array([[2.0, 0, 0], [1.0, 0, 0], [9.0, 0, 0]]))
    matched = associate(Trajectory(np.array([1.0, 2.0]), np.zeros((2, 3))), reference)
    np.testing.assert_array_equal(matched.reference.poses[:, 0], [1.0, 2.0])
    assert "1 repeated stamps" in matched.notes[0]


def test_no_common_time_is_an_error_that_names_both_spans():
    late = Trajectory(straight(5).stamps + 1000.0, straight(5).poses)
    with pytest.raises(AssociationError, match=r"5 poses from 0\.0.*from 1000\.0.*within 0\.01 s"):
        associate(straight(5), late)


def at_x(stamps, x) -> Trajectory:
    """Poses on the x axis."""
    return Trajectory(np.array(stamps), np.column_stack([x, np.zeros(len(x)), np.zeros(len(x))]))


@pytest.mark.parametrize(
    ("stamp", "partner"),
    [
        (-0.25, 0.0),  # before the first pose, at the tolerance
        (-0.26, None),
        (0.25, 0.0),  # at the tolerance
        (0.375, None),
        (0.75, 1.0),
        (1.5, 1.0),  # half way: the earlier one
        (2.25, 2.0),  # behind the last pose
        (2.26, None),
    ],
)
def test_the_nearest_within_the_tolerance_is_the_partner(stamp, partner):
    reference = at_x([0.0, 1.0, 2.0], [0.0, 1.0, 2.0])
    settings = {"interpolate": False, "tolerance": 0.5 if stamp == 1.5 else 0.25}
    estimate = at_x([1.0, stamp], [1.0, 0.0])
    matched = associate(estimate, reference, **settings)
    found = dict(zip(matched.estimate.stamps.tolist(), matched.reference.poses[:, 0].tolist(), strict=True))
    assert found.get(stamp) == partner
    assert matched.method == f"nearest within {settings['tolerance']} s"


@pytest.mark.parametrize(("stamp", "found"), [(0.0, True), (0.25, True), (0.5, True), (1.5, True), (2.0, False)])
def test_gaps_are_bridged_up_to_their_limit(stamp, found):
    reference = at_x([0.0, 0.5, 1.0, 2.0, 5.0], [0.0, 0.5, 1.0, 2.0, 5.0])
    matched = associate(at_x([0.125, stamp + 0.125], [0.0, 0.0]), reference, max_gap=1.0)
    assert len(matched.rows) == 1 + found
    np.testing.assert_allclose(matched.reference.poses[:, 0], matched.estimate.stamps)
    assert matched.method == "interpolated over gaps up to 1.0 s, else nearest within 0.01 s"
    assert not matched.same_stamps
    assert associate(reference, reference).same_stamps


@pytest.mark.parametrize(("matching", "accepted"), [(1, False), (2, True), (3, True)])
def test_one_percent_of_the_poses_must_match(matching, accepted):
    reference = at_x(np.arange(matching), np.zeros(matching))
    estimate = at_x(np.r_[np.arange(matching), 1000.0 + np.arange(200 - matching)], np.zeros(200))
    if accepted:
        assert len(associate(estimate, reference).rows) == matching
    else:
        with pytest.raises(AssociationError, match="only 1 poses"):
            associate(estimate, reference)


def test_defaults_and_notes_of_a_match():
    """Gaps up to half a second are bridged; all poses matched, in order and once, need no note."""
    reference = at_x([0.0, 0.5, 1.01, 1.5], [0.0, 0.5, 1.01, 1.5])
    matched = associate(at_x([0.25, 0.75, 1.25], np.zeros(3)), reference)
    assert matched.rows.tolist() == [0, 2]
    assert associate(at_x([0.25, 1.25], np.zeros(2)), reference).notes == ()
    twice = associate(at_x([0.25, 1.25], np.zeros(2)), at_x([0.0, 0.0, 0.5, 1.01, 1.5], [0.0, 9.0, 0.5, 1.01, 1.5]))
    assert "1 repeated stamps in the reference" in twice.notes[0]
    assert twice.reference.poses[0, 0] == pytest.approx(0.25)
    with pytest.raises(AssociationError, match=r"or between poses up to 0\.5 s apart: are both in seconds"):
        associate(at_x([50.0], [0.0]), reference)
    with pytest.raises(AssociationError, match=r"within 0\.01 s: are both in seconds"):
        associate(at_x([50.0], [0.0]), reference, interpolate=False)


def test_the_covered_share_counts_pieces_up_to_ten_metres():
    truth = straight(401, step=0.1)  # 40 m in 40 s

    def share(rows) -> float:
        return covered_share(associate(truth[rows], truth, interpolate=False), truth)

    assert share([0, 99]) == pytest.approx(9.9 / 40.0)
    assert share([0, 101]) == 0.0
    standing = Trajectory(truth.stamps, np.zeros((401, 3)))
    assert covered_share(associate(standing, standing), standing) == 1.0


def test_a_path_that_begins_with_a_stop_is_covered_like_any_other():
    """Only its length counts, also where all of it lies in the last step and is short."""
    reference = at_x([0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 0.5])
    assert covered_share(associate(reference[[0, 1]], reference, interpolate=False), reference) == 0.0
    assert covered_share(associate(reference[[0, 3]], reference, interpolate=False), reference) == 1.0


def test_a_small_step_back_is_noted():
    reference = at_x([0.0, 1.0, 2.0], [0.0, 1.0, 2.0])
    assert "step back 1 times" in associate(at_x([1.0, 0.5], [0.0, 0.0]), reference, max_gap=1.0).notes[0]
