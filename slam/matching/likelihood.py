# SPDX-License-Identifier: MIT
"""The likelihood p(z | m, x) of a scan: the beam end point model (Thrun, Burgard, Fox 2005, section 6.4)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.config import MapConfig, MatchConfig
from slam.grid.particle_maps import ParticleMaps
from slam.matching._likelihood_kernels import score_poses, wall_distances
from slam.motion.odometry_model import MotionPrior


class BeamModel(NamedTuple):
    """The beam end point model."""

    per_sigma2: float
    """1 / s^2 [1/m^2]."""
    per_outlier2: float
    """1 / c^2 [1/m^2]."""
    weight: float
    """w: share of each beam's log-likelihood that counts."""
    far: float
    """Distance charged where no wall is within the field's radius [m]."""


class ScanAndPrior(NamedTuple):
    """The scan and the motion prior, by which a new pose is judged: the same for all particles."""

    hits: NDArray[np.float64]
    """End points of the scan in the robot's frame [m], (K, 2)."""
    beams: BeamModel
    """Likelihood of the scan."""
    prior: MotionPrior
    """Density of the pose about the one that the odometry predicts."""


def make_beam_model(match: MatchConfig, grid: MapConfig) -> BeamModel:
    """The beam end point model of these settings."""
    return BeamModel(
        per_sigma2=match.hit_sigma**-2.0,
        per_outlier2=match.outlier_distance**-2.0,
        weight=match.beam_weight,
        far=grid.field_radius,
    )


def distances_to_walls(maps: ParticleMaps, pose: se2.Pose, hits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance (K,) [m] of each end point from the nearest wall in the map of particle 0; at most the field's radius.

    pose (3,) in the map's frame;  hits (K, 2) end points in the robot's frame [m]
    """
    vectors = np.empty((4, len(hits)))
    wall_distances(maps.grids, 0, *pose, hits, maps.config.field_radius, vectors)
    distances: NDArray[np.float64] = np.hypot(vectors[0], vectors[1])
    return distances


def log_likelihoods(
    maps: ParticleMaps, poses: se2.Pose, hits: NDArray[np.float64], model: BeamModel
) -> NDArray[np.float64]:
    """Log-likelihood (n,) [nats, up to a constant] of a scan at poses (n, 3) in the map of particle 0; hits (K, 2)."""
    logs = np.empty(len(poses))
    maps.threads.run(score_poses, len(poses), maps.grids, poses, hits, model, logs)
    return logs
