# SPDX-License-Identifier: MIT
"""Importance weights of the particles, kept as logarithms."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.particles._weight_kernels import mixture_covariance


@dataclass(frozen=True, eq=False)
class Weights:
    """Normalised log-weights; immutable."""

    logs: NDArray[np.float64]
    """Logarithms of the weights, (particles,), of which the exponentials sum to 1."""

    @classmethod
    def uniform(cls, count: int) -> Weights:
        """Equal weights of `count` particles."""
        return cls(np.full(count, -np.log(count)))

    def times(self, log_gain: NDArray[np.float64]) -> tuple[Weights, float]:
        """Weights multiplied by `exp(log_gain)` (particles,) and normalised again; and the log of the sum lost.

        That sum is the evidence of the observation given the past. NaN gains count as 0; if no particle has a
        finite gain left, all weights stay as they are and the evidence is -inf.
        """
        logs = self.logs + np.where(np.isnan(log_gain), -np.inf, log_gain)
        top = logs.max()
        if not np.isfinite(top):
            return self, -np.inf
        evidence = float(top + np.log(np.sum(np.exp(logs - top))))
        return Weights(logs - evidence), evidence

    @cached_property
    def values(self) -> NDArray[np.float64]:
        """The weights, (particles,), read-only; they sum to 1."""
        values = np.exp(self.logs)
        values /= values.sum()
        values.flags.writeable = False
        return values

    @property
    def ess(self) -> float:
        """Effective sample size 1 / sum w^2 (Kong, Liu, Wong 1994; T-RO 2007, equation 20), in [1, particles]."""
        return float(1.0 / np.sum(self.values**2))


def pose_covariance(poses: se2.Pose, weights: NDArray[np.float64], spread: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance (3, 3) of a weighted mixture of Gaussians over poses, in the frame of the poses.

    poses (particles, 3): means;  weights (particles,): their sum is 1;  spread (particles, 3, 3): covariances
    """
    covariance = np.empty((3, 3))
    mixture_covariance(poses, weights, spread, covariance)
    return covariance
