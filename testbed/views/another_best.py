# SPDX-License-Identifier: MIT
"""How far the reported pose moves because another particle becomes the best."""

from __future__ import annotations

import math

from eval.wording import length
from slam.step.step_report import StepReport

MIN_JUMP_M = 0.03
"""A smaller motion gets no mark and no line [m]."""


def moved_by_another_best(best_before: int | None, step: StepReport) -> float:
    """Distance [m] between the pose of the best particle and that of the one that was the best before; 0 where it is
    the same one, NaN where that is unknown.

    best_before: its number after the update before, and after its resampling; None = unknown
    """
    if best_before is None or step.proposed is None:
        return math.nan
    if best_before == step.best:
        return 0.0
    return math.dist(step.proposed.pose[best_before][:2], step.pose[:2])


def errors_in_words(before: float, now: float) -> str:
    """Say whether the reported pose came closer to the truth, by its position errors at the update before and now
    [m]."""
    if length(before) == length(now):
        return f"as far from the truth as before ({length(now)} off)"
    return f"{'away from' if now > before else 'closer to'} the truth ({length(before)} to {length(now)} off)"
