# SPDX-License-Identifier: MIT
"""Sentences on what looks like a wrong unit, sign or frame: a bad score may be the file's fault."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eval.trajectory.alignment import MIN_POSES, align
from eval.trajectory.association import Association
from eval.trajectory.trajectory import Trajectory
from slam.se2 import Pose, wrap_angle

OFF_DEG, FITS_DEG = 20.0, 10.0
"""Headings this far off beside positions that fit are suspect; this close once they are read the other way round, they
were meant so [deg]."""
FITS_SHARE = 0.1
"""Positions whose error falls below this share of what it was, or of their extent, fit."""


def check_trajectory(trajectory: Trajectory, name: str) -> list[str]:
    """What one trajectory shows by itself: headings in degrees, stamps in nanoseconds. `name` says whose it is."""
    found = []
    headings = np.abs(trajectory.poses[:, 2])
    # A heading may have been counted on over turns, but then it changes little from pose to pose.
    jumps = np.abs(np.diff(trajectory.poses[:, 2]))
    if headings.max() > 4.0 * np.pi and len(jumps) and jumps.max() > 2.0 * np.pi + 1e-9:
        found.append(f"{name}: headings of up to {headings.max():.0f} rad that jump: are they degrees?")
    if len(trajectory) > 1:
        step = float(np.median(np.abs(np.diff(trajectory.stamps))))
        if step > 1e4:
            found.append(f"{name}: {step:.3g} s between poses: are the stamps milli- or nanoseconds?")
    return found


def check_pair(matched: Association) -> list[str]:
    """What an estimate shows beside the truth: another unit of length, a mirrored plane, headings in another sense."""
    p, q = matched.estimate.poses, matched.reference.poses
    if len(p) < MIN_POSES:
        return []
    before = _misfit(p, q)
    mirrored = p * [1.0, -1.0, -1.0]
    if _misfit(mirrored, q) < FITS_SHARE * before:
        return ["the estimate fits the reference only when mirrored: does its y point to the left of x?"]
    return [sentence for sentence in (_scale(p, q), _headings(p, q)) if sentence]


def _misfit(p: Pose, q: Pose) -> float:
    """Root mean square distance after SE(2) alignment [m]."""
    aligned = align(p, q, "se2").apply(p)
    return float(np.sqrt(np.mean(np.sum((aligned - q)[:, :2] ** 2, axis=1))))


def _scale(p: Pose, q: Pose) -> str | None:
    """The scale of least squares over the centred, turned positions (Umeyama 1991, eq. 42), where it mends them."""
    aligned = align(p, q, "se2").apply(p)
    dp, dq = aligned[:, :2] - aligned[:, :2].mean(axis=0), q[:, :2] - q[:, :2].mean(axis=0)
    spread = np.sum(dp * dp)
    if spread == 0.0 or np.sum(dq * dq) == 0.0:
        return None
    scale = float(np.sum(dp * dq) / spread)
    before = float(np.sqrt(np.mean(np.sum((dp - dq) ** 2, axis=1))))
    after = float(np.sqrt(np.mean(np.sum((scale * dp - dq) ** 2, axis=1))))
    if 0.5 < scale < 2.0 or after > FITS_SHARE * before:
        return None
    return f"the estimate fits the reference only when scaled by {scale:.4g}: are its positions in metres?"


def _headings(p: Pose, q: Pose) -> str | None:
    """Headings that do not fit although the positions do."""
    alignment = align(p, q, "se2")
    off = _rms_degrees(p[:, 2] + alignment.T_reference_estimate[2] - q[:, 2])
    extent = float(np.sqrt(np.mean(np.sum((q - q.mean(axis=0))[:, :2] ** 2, axis=1))))
    if off < OFF_DEG or _misfit(p, q) > FITS_SHARE * extent:
        return None
    if _rms_degrees(p[:, 2] - alignment.T_reference_estimate[2] + q[:, 2]) < FITS_DEG:
        return "the headings fit the truth only when counted clockwise: they are to grow counter-clockwise"
    return (
        f"the positions fit the truth, the headings do not ({off:.0f} degrees rmse): are they in radians, and those of "
        "the robot's x axis?"
    )


def _rms_degrees(angles: NDArray[np.float64]) -> float:
    return float(np.degrees(np.sqrt(np.mean(wrap_angle(angles) ** 2))))
