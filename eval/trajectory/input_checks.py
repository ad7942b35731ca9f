# SPDX-License-Identifier: MIT
"""Recognise wrong units, signs and frames of trajectories: a bad score may be caused by the file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.alignment import MIN_POSES, align
from eval.trajectory.association import Association
from eval.trajectory.trajectory import Trajectory
from slam.se2 import Pose, wrap_angle

MAX_HEADING_ERROR_DEG, MAX_FLIPPED_ERROR_DEG = 20.0, 10.0
"""Headings with a larger rms error are suspect where the positions fit; they are clockwise where their rms error, with
the sign changed, is below the second value [deg]."""
MAX_MISFIT_SHARE = 0.1
"""Positions fit if their error is below this share of the error before a correction, or of their extent."""


def check_trajectory(trajectory: Trajectory, name: str) -> list[str]:
    """Check one trajectory for headings in degrees and stamps in nanoseconds; `name` begins the sentences returned."""
    found = []
    headings = np.abs(trajectory.poses[:, 2])
    # A heading may grow beyond a full turn, but then it changes little from pose to pose.
    jumps = np.abs(np.diff(trajectory.poses[:, 2]))
    if headings.max() > 4.0 * np.pi and len(jumps) and jumps.max() > 2.0 * np.pi + 1e-9:
        found.append(f"{name}: headings of up to {headings.max():.0f} rad that jump: are they degrees?")
    if len(trajectory) > 1:
        step = float(np.median(np.abs(np.diff(trajectory.stamps))))
        if step > 1e4:
            found.append(f"{name}: {step:.3g} s between poses: are the stamps milli- or nanoseconds?")
    return found


def check_pair(matched: Association) -> list[str]:
    """Check an estimate against the truth for another unit of length, a mirrored plane, and clockwise headings."""
    p, q = matched.estimate.poses, matched.reference.poses
    if len(p) < MIN_POSES:
        return []
    before = _misfit(p, q)
    mirrored = p * [1.0, -1.0, -1.0]
    if _misfit(mirrored, q) < MAX_MISFIT_SHARE * before:
        return ["the estimate fits the reference only when mirrored: does its y point to the left of x?"]
    return [sentence for sentence in (_scale(p, q), _headings(p, q)) if sentence]


def _misfit(p: Pose, q: Pose) -> float:
    """Return the root mean square distance after SE(2) alignment [m]."""
    aligned = align(p, q, "se2").apply(p)
    return float(np.sqrt(np.mean(np.sum((aligned - q)[:, :2] ** 2, axis=1))))


def _scale(p: Pose, q: Pose) -> str | None:
    """Name the least-squares scale of the aligned positions (Umeyama 1991, eq. 42) where it makes them fit."""
    aligned = align(p, q, "se2").apply(p)
    dp, dq = aligned[:, :2] - aligned[:, :2].mean(axis=0), q[:, :2] - q[:, :2].mean(axis=0)
    squares = np.sum(dp * dp)
    if squares == 0.0 or np.sum(dq * dq) == 0.0:
        return None
    scale = float(np.sum(dp * dq) / squares)
    before = float(np.sqrt(np.mean(np.sum((dp - dq) ** 2, axis=1))))
    after = float(np.sqrt(np.mean(np.sum((scale * dp - dq) ** 2, axis=1))))
    if 0.5 < scale < 2.0 or after > MAX_MISFIT_SHARE * before:
        return None
    return f"the estimate fits the reference only when scaled by {scale:.4g}: are its positions in metres?"


def _headings(p: Pose, q: Pose) -> str | None:
    """Name headings that do not fit although the positions do."""
    alignment = align(p, q, "se2")
    off = _rms_degrees(p[:, 2] + alignment.T_reference_estimate[2] - q[:, 2])
    extent = float(np.sqrt(np.mean(np.sum((q - q.mean(axis=0))[:, :2] ** 2, axis=1))))
    if off < MAX_HEADING_ERROR_DEG or _misfit(p, q) > MAX_MISFIT_SHARE * extent:
        return None
    if _rms_degrees(p[:, 2] - alignment.T_reference_estimate[2] + q[:, 2]) < MAX_FLIPPED_ERROR_DEG:
        return "the headings fit the truth only when counted clockwise: they must grow counter-clockwise"
    return (
        f"the positions fit the truth, the headings do not ({off:.0f} degrees rmse): are they in radians, and do they "
        "belong to the robot's x axis?"
    )


def _rms_degrees(angles: NDArray[np.float64]) -> float:
    return float(np.degrees(np.sqrt(np.mean(wrap_angle(angles) ** 2))))
