# SPDX-License-Identifier: MIT
"""Wrong units, signs and frames are named; honest errors are not suspected."""

import numpy as np
import pytest

from eval.trajectory.association import associate
from eval.trajectory.input_checks import check_pair, check_trajectory
from eval.trajectory.trajectory import Trajectory
from slam.se2 import compose, wrap_angle
from tests.eval.helpers import noisy, random_walk

TRUTH = random_walk(400, 1)
ELSEWHERE = [4.0, -2.0, 1.3]


def doubts(poses) -> list[str]:
    """On an estimate of the truth's times."""
    return check_pair(associate(Trajectory(TRUTH.stamps, poses), TRUTH))


def test_degrees_and_nanoseconds_are_named_and_full_turns_are_not():
    rng = np.random.default_rng(0)
    stamps = np.arange(100.0)
    degrees = np.column_stack([stamps, stamps, rng.uniform(-180.0, 180.0, 100)])
    assert "degrees" in check_trajectory(Trajectory(stamps, degrees), "estimate")[0]
    assert "nanoseconds" in check_trajectory(Trajectory(stamps * 1e8, degrees * 0.0), "estimate")[0]
    assert check_trajectory(Trajectory(stamps, np.column_stack([stamps, stamps, 0.3 * stamps])), "estimate") == []


@pytest.mark.parametrize("factor", [100.0, 1000.0, 3.2808])
def test_another_unit_of_length_is_named_with_its_factor(factor):
    scaled = compose(ELSEWHERE, TRUTH.poses) * [factor, factor, 1.0]
    assert f"scaled by {1.0 / factor:.4g}" in doubts(scaled)[0]


def test_headings_in_degrees_or_of_another_axis_are_named():
    there = compose(ELSEWHERE, noisy(TRUTH, 5, 0.01).poses)
    for headings in (np.degrees(there[:, 2]), there[:, 2] + np.pi / 2):
        read = np.column_stack([there[:, :2], wrap_angle(headings)])  # as a quaternion makes of it
        assert "in radians" in doubts(read)[0]


def test_clockwise_headings_and_a_mirrored_plane_are_named():
    there = compose(ELSEWHERE, TRUTH.poses)
    assert "clockwise" in doubts(there * [1.0, 1.0, -1.0])[0]
    assert "mirrored" in doubts(there * [1.0, -1.0, -1.0])[0]


@pytest.mark.parametrize(
    "poses",
    [
        TRUTH.poses,
        compose(ELSEWHERE, TRUTH.poses),
        noisy(TRUTH, 2, 0.3).poses,
        TRUTH.poses * [1.1, 1.1, 1.0],
        random_walk(400, 3).poses * [0.01, 0.01, 1.0],  # small, and not the truth at any scale
        TRUTH.poses + np.array([0.0, 0.0, 0.2]),
    ],
)
def test_honest_errors_are_not_suspected(poses):
    assert doubts(poses) == []


def test_two_poses_show_nothing():
    assert check_pair(associate(Trajectory(TRUTH.stamps[:2], 100.0 * TRUTH.poses[:2]), TRUTH)) == []
