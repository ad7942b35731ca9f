# SPDX-License-Identifier: MIT
"""Where the robot is at a moment, by the estimate and by the truth, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from slam import se2
from slam.se2 import Pose
from testbed.views.rerun.drawing import ELLIPSE_SIGMAS

SAME_TIME_S = 0.05
"""An ellipse that is no older than this belongs to the same moment [s]."""
MIN_DEVIATION = 1e-4
"""At the first scan the covariance is 0, and the truth lies where the estimate is but for rounding [m]."""


def within_ellipse(place: NDArray[np.float64], pose: Pose, covariance: NDArray[np.float64]) -> bool:
    """Whether a place (2,) [m] lies within the ellipse that is drawn for a pose (3,) with a covariance (3, 3)."""
    (xx, xy), (_, yy) = covariance[:2, :2].tolist()
    xx, yy = xx + MIN_DEVIATION**2, yy + MIN_DEVIATION**2
    x, y = (place[:2] - pose[:2]).tolist()
    determinant = xx * yy - xy * xy
    return bool(yy * x * x - 2.0 * xy * x * y + xx * y * y <= ELLIPSE_SIGMAS**2 * determinant)


def in_words(estimate: Pose, truth: Pose | None, within: bool | None, age: float = 0.0) -> str:
    """Name both positions in the world's frame, and whether the filter's ellipse held the truth at the last update.

    estimate, truth: poses (3,); truth, within: None = unknown. age: time since that update [s]
    """
    words = f"estimate {_position(estimate)}"
    if truth is None:
        return words
    words += f", truth {_position(truth)}"
    if within is None:
        return words
    is_, when = ("is", "") if age < SAME_TIME_S else ("was", f" {age:.1f} s before, at the last update")
    return f"{words}, which {is_} {'inside' if within else 'outside'} the filter's 95 % ellipse{when}"


def _position(pose: Pose) -> str:
    x, y, _ = pose.tolist()
    return f"({x:.2f}, {y:.2f}) m"


@dataclass(frozen=True, eq=False)
class NowColumns:
    """Sentences; rows (estimate (3,), truth (3,) or None, within or None, age), the estimate in the map's frame."""

    T_world_map: Pose

    def __call__(self, rows: Sequence[tuple[Any, ...]]) -> rr.ComponentColumnList:
        """One sentence for each row."""
        estimates = se2.compose(self.T_world_map, np.array([row[0] for row in rows]))
        texts = [in_words(estimate, *row[1:]) for estimate, row in zip(estimates, rows, strict=True)]
        return rr.TextDocument.columns(text=texts)
