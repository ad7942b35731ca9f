# SPDX-License-Identifier: MIT
"""Move an estimate into the reference's frame; each method has a name, because it changes the error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from slam.se2 import Pose, compose, inverse, wrap_angle

Method = Literal["none", "first_pose", "se2"]
MIN_POSES = 3
"""Smallest number of poses: with fewer, any two trajectories fit after alignment, and the error means nothing."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """A rigid motion that takes an estimate into the reference's frame, and how it was found."""

    T_reference_estimate: Pose
    """Pose of the estimate's frame seen from the reference's [m, m, rad], (3,)."""
    method: Method
    """`none`: identity; `first_pose`: the first poses coincide; `se2`: least squares over all positions."""
    heading_from_poses: bool = False
    """`se2` only: all positions coincide, so the rotation comes from the headings."""

    def apply(self, poses: ArrayLike) -> Pose:
        """Transform poses (..., 3) from the estimate's frame to the reference's."""
        return compose(self.T_reference_estimate, poses)


def align(estimate: ArrayLike, reference: ArrayLike, method: Method = "se2") -> Alignment:
    """Align the poses `estimate` (n, 3) to the poses `reference` (n, 3), row by row.

    `se2` minimises sum |R p_i + t - q_i|^2 over rotation R and shift t, without scale (Umeyama, PAMI 13(4), 1991, in
    the plane in closed form). Trap: it distributes the error over the whole path and hides where it began;
    `first_pose` shows how drift grows, but an error of the first heading turns the whole path.
    Raises ValueError where the shapes differ or the method is unknown.
    """
    p, q = np.asarray(estimate, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    if p.shape != q.shape or p.ndim != 2 or p.shape[1] != 3 or len(p) == 0:
        raise ValueError(f"align takes two arrays (n, 3) of the same length, got {p.shape} and {q.shape}")
    if method == "none":
        return Alignment(np.zeros(3), method)
    if method == "first_pose":
        return Alignment(compose(q[0], inverse(p[0])), method)
    if method == "se2":
        return _umeyama(p, q)
    raise ValueError(f"alignment: expected none, first_pose or se2, got {method!r}")


def _umeyama(p: Pose, q: Pose) -> Alignment:
    p_mean, q_mean = p[:, :2].mean(axis=0), q[:, :2].mean(axis=0)
    dp, dq = p[:, :2] - p_mean, q[:, :2] - q_mean
    cosine = np.sum(dp * dq)
    sine = np.sum(dp[:, 0] * dq[:, 1] - dp[:, 1] * dq[:, 0])
    # Where all positions coincide, rounding leaves about eps times the squares of the coordinates.
    one_point = np.hypot(cosine, sine) <= 1e-12 * (np.sum(p[:, :2] ** 2) + np.sum(q[:, :2] ** 2) + 1e-300)
    if one_point:
        turns = wrap_angle(q[:, 2] - p[:, 2])
        cosine, sine = np.cos(turns).sum(), np.sin(turns).sum()
    theta = np.arctan2(sine, cosine)
    cos, sin = np.cos(theta), np.sin(theta)
    shift = q_mean - np.array([cos * p_mean[0] - sin * p_mean[1], sin * p_mean[0] + cos * p_mean[1]])
    return Alignment(np.array([shift[0], shift[1], theta]), "se2", heading_from_poses=bool(one_point))
