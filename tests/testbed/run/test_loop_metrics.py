# SPDX-License-Identifier: MIT
"""The errors of a loop's match and of the filter's path are those against the true motion between the two visits."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from eval.trajectory.trajectory import Trajectory
from slam import se2
from testbed.run.loop_metrics import loop_metrics

STAMPS = 10.0 + np.arange(6.0)
TRUE = np.array(
    [[0.0, 0.0, 0.3], [1.0, 0.0, 0.5], [2.0, 1.0, 1.5], [2.0, 2.0, 2.5], [1.0, 2.0, -2.0], [0.1, 0.2, -1.0]]
)


def closing(match: np.ndarray) -> SimpleNamespace:
    """One accepted loop between the frames 1 and 5."""
    loop = SimpleNamespace(
        first=0, second=1, pose=match, was_closed=True, overlap=18.1, agreement=SimpleNamespace(share=0.96)
    )
    return SimpleNamespace(frames=np.array([1, 5]), loops=[loop], accepted=np.array([True]), changed=False)


def test_each_error_is_that_of_its_own_motion() -> None:
    frame = np.array([3.0, -2.0, 0.7])  # the map's frame is not the world's, which changes no motion
    path = se2.compose(frame, TRUE)
    path[5] = se2.compose(path[5], [0.03, 0.04, np.radians(2.0)])  # the filter is wrong by 5 cm and 2 degrees
    true_motion = se2.between(TRUE[1], TRUE[5])
    match = se2.compose(true_motion, [0.0, -0.12, np.radians(-3.0)])
    found = loop_metrics(closing(match), Trajectory(STAMPS, path), Trajectory(STAMPS[::-1], TRUE[::-1]))["list"][0]
    assert (found["filter_error_m"], found["filter_error_deg"]) == pytest.approx((0.05, 2.0))
    assert (found["match_error_m"], found["match_error_deg"]) == pytest.approx((0.12, 3.0))
    assert found["gap_deg"] == pytest.approx(5.0)


def test_the_truth_is_interpolated_between_scans() -> None:
    """The second visit is a frame without a scan, half way between two true poses 0.4 s apart."""
    half = np.array([0.0, 0.0, 0.0]), np.array([0.2, 0.0, 0.0])
    stamps, poses = np.array([11.0, 14.8, 15.2]), np.array([TRUE[1], *(se2.compose(TRUE[5], step) for step in half)])
    there = se2.compose(TRUE[5], [0.1, 0.0, 0.0])
    match = se2.between(TRUE[1], there)
    found = loop_metrics(closing(match), Trajectory(STAMPS, TRUE), Trajectory(stamps, poses))["list"][0]
    assert (found["match_error_m"], found["match_error_deg"]) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert found["filter_error_m"] == pytest.approx(0.1)


@pytest.mark.parametrize("truth", [None, Trajectory(STAMPS[:5], TRUE[:5]), Trajectory(STAMPS + 0.5, TRUE)])
def test_without_truth_at_both_visits_there_are_no_errors(truth: Trajectory | None) -> None:
    found = loop_metrics(closing(np.zeros(3)), Trajectory(STAMPS, TRUE), truth)["list"][0]
    assert not any("error" in key for key in found)
    assert found["gap_m"] > 0.0
