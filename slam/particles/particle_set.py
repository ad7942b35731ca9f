# SPDX-License-Identifier: MIT
"""The particles of a filter: poses, weights and histories, that is, all but their maps (`slam.grid`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.particles.ancestry import Ancestry
from slam.particles.weights import Weights, pose_covariance


class ParticleSet:
    """Particles that move, are weighted and are resampled together."""

    def __init__(self, poses: se2.Pose) -> None:
        """Particles of equal weight at poses (particles, 3), without a history."""
        self.poses = poses
        """Poses at the last used scan, (particles, 3)."""
        self.covariances = np.zeros((len(poses), 3, 3))
        """Covariances of the proposals that the poses were drawn from, (particles, 3, 3)."""
        self.errors = np.zeros((len(poses), 3))
        """By how much the poses were drawn off the means of these proposals, in standard deviations, (particles, 3)."""
        self.weights = Weights.uniform(len(poses))
        """Weights since the last resampling."""
        self.log_histories = np.zeros(len(poses))
        """Log-weight of each particle's whole history, up to a common constant, (particles,): resampling keeps it."""
        self.ancestry = Ancestry(len(poses))

    def __len__(self) -> int:
        """Number of particles."""
        return len(self.poses)

    @property
    def best(self) -> int:
        """Number of the most likely particle: that of the largest weight over its whole history; the first at a tie.

        Right after resampling all weights are equal and say nothing; the product of all weights that a history has had
        still ranks the maps by their likelihood (T-RO 2007, equation 1).
        """
        return int(np.argmax(self.log_histories))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance (3, 3) of the pose in the map's frame: scatter of the particles plus that of their proposals."""
        return pose_covariance(self.poses, self.weights.values, self.covariances)

    def move(
        self, poses: se2.Pose, covariances: NDArray[np.float64], log_gain: NDArray[np.float64], history: se2.Pose
    ) -> float:
        """Move all particles to poses (particles, 3), and multiply their weights by exp(log_gain) (particles,).

        covariances (particles, 3, 3) of the proposals;  history (particles, 3): poses that the histories keep
        Returns the log-evidence of the observation [nats].
        """
        self.poses, self.covariances = poses, covariances
        before = self.weights
        self.weights, evidence = before.times(log_gain)
        if self.weights is not before:  # some particle has a finite gain
            alive = np.isfinite(self.weights.logs)
            self.log_histories[~alive] = -np.inf
            self.log_histories[alive] += self.weights.logs[alive] - before.logs[alive]
        self.ancestry.add(history)
        return evidence

    def resample(self, ancestors: NDArray[np.int64]) -> None:
        """Replace the particles by offspring of equal weight: offspring i continues particle `ancestors[i]`."""
        self.poses, self.covariances = self.poses[ancestors], self.covariances[ancestors]
        self.errors = self.errors[ancestors]
        self.log_histories = self.log_histories[ancestors]
        self.ancestry.inherit(ancestors)
        self.weights = Weights.uniform(len(ancestors))
