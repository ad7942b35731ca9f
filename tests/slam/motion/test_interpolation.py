# SPDX-License-Identifier: MIT
"""Odometry between known poses: exact where it must be, and no worse than dead reckoning anywhere."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slam import se2
from slam.motion.interpolation import between_updates, interpolate_with_odometry


def walk(seed: int, frames: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    steps = np.column_stack([rng.uniform(0, 0.2, frames), rng.normal(0, 0.01, frames), rng.normal(0, 0.2, frames)])
    poses = [rng.normal(size=3)]
    for step in steps[1:]:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def assert_poses_close(a, b, atol=1e-9):
    np.testing.assert_allclose(a[:, :2], b[:, :2], atol=atol)
    np.testing.assert_allclose(se2.wrap_angle(a[:, 2] - b[:, 2]), 0.0, atol=atol)


known_frames = st.integers(2, 30).flatmap(
    lambda m: st.tuples(st.just(m), st.sets(st.integers(0, m - 1), min_size=1).map(sorted))
)


@given(seed=st.integers(0, 2**32 - 1), case=known_frames)
def test_perfect_odometry_gives_the_truth_everywhere(seed, case):
    frames, known = case
    truth = walk(seed, frames)
    odometry = se2.compose([3.0, -2.0, 1.0], truth)  # same motion, another frame
    assert_poses_close(interpolate_with_odometry(odometry, np.array(known), truth[known]), truth)


@given(seed=st.integers(0, 2**32 - 1), case=known_frames)
def test_known_poses_are_kept_whatever_the_odometry_says(seed, case):
    frames, known = case
    poses = walk(seed + 1, frames)[known]
    assert_poses_close(interpolate_with_odometry(walk(seed, frames), np.array(known), poses)[known], poses)


def test_a_miss_is_spread_along_the_way():
    odometry = np.column_stack([np.linspace(0, 4, 5), np.zeros(5), np.zeros(5)])
    carried = interpolate_with_odometry(odometry, np.array([0, 4]), np.array([[0.0, 0, 0], [4.0, 0.4, 0.0]]))
    np.testing.assert_allclose(carried[:, 1], [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-12)


def test_frames_at_rest_stay_with_the_pose_before_them():
    odometry = np.zeros((4, 3))
    carried = interpolate_with_odometry(odometry, np.array([0, 3]), np.array([[0.0, 0, 0], [1.0, 0, 0]]))
    np.testing.assert_allclose(carried[:, 0], [0, 0, 0, 1])


def test_nothing_known_is_refused():
    with pytest.raises(ValueError, match="at least one"):
        interpolate_with_odometry(np.zeros((3, 3)), np.array([], dtype=int), np.zeros((0, 3)))


def slow_walk(frames, step=0.02):
    """A robot that drives straight on, so many metres each frame."""
    return np.column_stack([step * np.arange(frames), np.zeros(frames), np.zeros(frames)])


@pytest.mark.parametrize("jump", [(0.9, 0.1, 0.0), (0.0, 0.0, 1.2)])
@pytest.mark.parametrize("at", [11, 12, 16])
def test_frames_before_a_jump_stay_where_the_robot_was(jump, at):
    """The robot is carried or turned between two frames; the filter's next update is at the first frame after."""
    odometry = slow_walk(30)
    truth = odometry.copy()
    truth[at:] = se2.compose(se2.compose(truth[at - 1], jump), se2.between(odometry[at - 1], odometry[at:]))
    updates = np.array(sorted({0, 10, at, 20, 29}))
    assert_poses_close(between_updates(odometry, updates, truth[updates]), truth)


@pytest.mark.parametrize("counted", [-1.0, 0.5, 2.0])
def test_wheels_that_count_wrong_are_put_right_along_their_way(counted):
    """Backward instead of forward, half or twice the way."""
    truth, updates = slow_walk(40), np.arange(0, 40, 8)
    assert_poses_close(between_updates(counted * truth, updates, truth[updates])[:33], truth[:33])


def test_wheels_that_spin_are_put_right_where_they_spun():
    truth = slow_walk(20)
    odometry = truth.copy()
    odometry[12:] = se2.compose(se2.compose(truth[11], (0.02, 0.0, 0.8)), se2.between(truth[12], truth[12:]))
    found = between_updates(odometry, np.array([0, 6, 12, 18]), truth[[0, 6, 12, 18]])
    assert np.hypot(*(found - truth)[:19, :2].T).max() < 0.1
    assert np.abs(found - truth)[[7, 8, 9, 10], 2].max() < 0.25


@given(seed=st.integers(0, 2**32 - 1), case=known_frames)
def test_small_residuals_between_updates_are_distributed(seed, case):
    frames, known = case
    odometry, updates = walk(seed, frames), np.array(known)
    path = odometry[updates] + np.random.default_rng(seed).uniform(-0.02, 0.02, (len(known), 3))
    np.testing.assert_array_equal(
        between_updates(odometry, updates, path), interpolate_with_odometry(odometry, updates, path)
    )
