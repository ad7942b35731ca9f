# SPDX-License-Identifier: MIT
"""The words for a moment: both positions in the world's frame, and whether the drawn ellipse holds the truth."""

from __future__ import annotations

import numpy as np
import pytest

from testbed.views.rerun.drawing import ellipses
from testbed.views.rerun.now import NowColumns, in_words, within_ellipse


def test_the_ellipse_that_is_drawn_is_the_one_that_is_asked() -> None:
    """Just inside each end of its axes a place is within, just outside it is not."""
    covariance = np.diag([0.0, 0.0, 0.01])
    covariance[:2, :2] = [[0.04, 0.015], [0.015, 0.02]]
    pose = np.array([2.0, -1.0, 0.4])
    (half,), (angle,) = ellipses(covariance[None])
    for turn, length in zip((0.0, 90.0, 180.0, 270.0), (*half, *half), strict=True):
        along = np.array([np.cos(angle + np.radians(turn)), np.sin(angle + np.radians(turn))])
        assert within_ellipse(pose[:2] + 0.99 * length * along, pose, covariance)
        assert not within_ellipse(pose[:2] + 1.01 * length * along, pose, covariance)


def test_a_covariance_without_area_holds_its_own_place_only() -> None:
    assert within_ellipse(np.full(2, 1e-6), np.zeros(3), np.zeros((3, 3)))
    assert not within_ellipse(np.array([0.001, 0.0]), np.zeros(3), np.zeros((3, 3)))


@pytest.mark.parametrize(
    ("truth", "within", "words"),
    [
        (None, None, "estimate (17.61, 2.96) m"),
        (np.array([17.65, 3.104, 0.0]), None, "estimate (17.61, 2.96) m, truth (17.65, 3.10) m"),
        (
            np.array([17.65, 3.104, 0.0]),
            False,
            "estimate (17.61, 2.96) m, truth (17.65, 3.10) m, which is outside the filter's 95 % ellipse",
        ),
    ],
)
def test_positions_are_named(truth: np.ndarray | None, within: bool | None, words: str) -> None:
    assert in_words(np.array([17.611, 2.96, 0.3]), truth, within) == words


def test_the_estimate_is_named_in_the_frame_of_the_truth() -> None:
    """The map's frame is turned by 90 degrees."""
    build = NowColumns(np.array([1.0, 2.0, np.pi / 2.0]))
    rows = [(np.array([3.0, 0.0, 0.0]), np.array([1.0, 5.0, 0.0]), True, 0.3)]
    (column,) = build(rows)
    assert column.as_arrow_array().to_pylist() == [
        [
            "estimate (1.00, 5.00) m, truth (1.00, 5.00) m, which was inside the filter's 95 % ellipse 0.3 s before, "
            "at the last update"
        ]
    ]
