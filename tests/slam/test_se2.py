# SPDX-License-Identifier: MIT
"""SE(2): group laws, and agreement with homogeneous matrices."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from slam import se2
from tests.slam.strategies import poses


def matrix(pose):
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[cos, -sin, pose[0]], [sin, cos, pose[1]], [0.0, 0.0, 1.0]])


def assert_same(a, b):
    np.testing.assert_allclose(matrix(a), matrix(b), atol=1e-9)


@given(st.floats(-1e4, 1e4))
@example(np.pi)
@example(-np.pi)
@example(np.nextafter(-np.pi, -4.0))
@example(np.nextafter(np.pi, 0.0))
@example(-1e-300)
@settings(deadline=None)
def test_wrapped_angle_lies_in_a_half_open_turn_and_means_the_same(angle):
    wrap_angle = float(se2.wrap_angle(angle))
    assert -np.pi <= wrap_angle <= np.pi  # the sum of an angle and pi is rounded: the upper end may come out
    turns = (angle - wrap_angle) / (2.0 * np.pi)
    assert turns == pytest.approx(round(turns), abs=1e-11)


@given(poses(), poses())
@settings(deadline=None)
def test_compose_multiplies_matrices(a, b):
    np.testing.assert_allclose(matrix(se2.compose(a, b)), matrix(a) @ matrix(b), atol=1e-9)


@given(poses(), poses(), poses())
@settings(deadline=None)
def test_compose_is_associative(a, b, c):
    assert_same(se2.compose(se2.compose(a, b), c), se2.compose(a, se2.compose(b, c)))


@given(poses())
@settings(deadline=None)
def test_inverse_undoes_from_both_sides(a):
    assert_same(se2.compose(a, se2.inverse(a)), np.zeros(3))
    assert_same(se2.compose(se2.inverse(a), a), np.zeros(3))
    assert_same(se2.compose(a, np.zeros(3)), a)


@given(poses(), poses())
@settings(deadline=None)
def test_between_leads_from_one_pose_to_the_other(a, b):
    assert_same(se2.compose(a, se2.between(a, b)), b)
    assert_same(se2.between(a, b), se2.compose(se2.inverse(a), b))


@given(poses(), poses(), poses())
@settings(deadline=None)
def test_between_does_not_depend_on_the_frame(w, a, b):
    assert_same(se2.between(se2.compose(w, a), se2.compose(w, b)), se2.between(a, b))


@given(poses(), poses(), st.integers(0, 5))
@settings(deadline=None)
def test_points_are_moved_as_by_matrices_and_one_after_the_other(a, b, count):
    points = np.random.default_rng(count).normal(size=(count, 2))
    expected = (matrix(a) @ np.column_stack([points, np.ones(count)]).T).T[:, :2]
    np.testing.assert_allclose(se2.transform_points(a, points), expected, atol=1e-9)
    np.testing.assert_allclose(
        se2.transform_points(a, se2.transform_points(b, points)),
        se2.transform_points(se2.compose(a, b), points),
        atol=1e-9,
    )


def test_batches_broadcast_and_equal_single_poses():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(4, 1, 3)), rng.normal(size=(5, 3))
    for function in (se2.compose, se2.between):
        batch = function(a, b)
        assert batch.shape == (4, 5, 3)
        np.testing.assert_array_equal(batch[2, 3], function(a[2, 0], b[3]))
    assert se2.inverse(a).shape == (4, 1, 3)
    assert se2.transform_points(rng.normal(size=(4, 3)), rng.normal(size=(4, 7, 2))).shape == (4, 7, 2)


def test_known_answer():
    assert_same(se2.compose([1.0, 2.0, np.pi / 2.0], [3.0, 0.5, np.pi / 4.0]), [0.5, 5.0, 0.75 * np.pi])
