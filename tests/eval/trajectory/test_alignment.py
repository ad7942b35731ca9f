# SPDX-License-Identifier: MIT
"""Alignment takes back rigid motions, and none does better."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eval.trajectory.alignment import align
from eval.trajectory.association import associate
from eval.trajectory.errors import absolute_error
from eval.trajectory.trajectory import Trajectory
from slam.se2 import compose
from tests.eval.helpers import noisy, random_walk

pose = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.1, 3.1)).map(np.array)


@given(pose, st.integers(0, 1000))
@settings(max_examples=50, deadline=None)
def test_se2_alignment_takes_back_any_rigid_motion(T, seed):
    truth = random_walk(50, seed)
    moved = Trajectory(truth.stamps, compose(T, truth.poses))
    for method in ("se2", "first_pose"):
        error = absolute_error(associate(moved, truth), method)
        assert error.translation.max < 1e-9
        assert error.rotation.max < 1e-6


@given(pose, st.integers(0, 1000))
@settings(max_examples=30, deadline=None)
def test_no_rigid_motion_does_better_than_se2_alignment(T, seed):
    truth = random_walk(40, seed)
    estimate = noisy(truth, seed + 1)
    best = absolute_error(associate(estimate, truth), "se2")
    other = compose(T * 0.01, best.alignment.apply(estimate.poses))
    assert best.translation.rmse <= np.sqrt(np.mean(np.sum((other - truth.poses)[:, :2] ** 2, axis=1))) + 1e-12


def test_one_pose_is_aligned_by_its_heading():
    a, b = np.array([[1.0, 2.0, 0.3]]), np.array([[-4.0, 1.0, 2.0]])
    alignment = align(a, b, "se2")
    assert alignment.heading_from_poses
    np.testing.assert_allclose(alignment.apply(a), b, atol=1e-12)


def test_an_unknown_alignment_is_refused():
    with pytest.raises(ValueError, match="none, first_pose or se2"):
        align(np.zeros((1, 3)), np.zeros((1, 3)), "sim3")  # type: ignore[arg-type]
