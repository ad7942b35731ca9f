# SPDX-License-Identifier: MIT
"""One Gauss-Newton step for all poses of a recording at once: scans against surfels that follow, odometry between,
which is calibrated with them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam._threads import Threads
from slam.config import RefineConfig
from slam.motion.odometry_model import motion_prior
from slam.refinement._chain_kernels import add_odometry_steps
from slam.refinement._normal_equations_kernels import SurfelObservations, collect, count_surfels
from slam.refinement._surfel_match_kernels import GATE_SIGMAS, Matches, match_points, weigh_points
from slam.refinement.joint_equations import Equations, JointEquations
from slam.refinement.noise import INITIAL, Noise, estimate_noise, for_weights
from slam.refinement.odometry_calibration import OdometryCalibration
from slam.refinement.odometry_noise import variance_factors, with_variances
from slam.refinement.surfels import (
    Cells,
    Cloud,
    PlacedCloud,
    Surfels,
    find_surfels,
    make_cells,
    transform_cloud,
)

GAUGE = 1e-2
"""Precision of the first pose [1/m^2, 1/rad^2], which alone ties the trajectory to the frame. It is weak, so that it
costs no iterations; callers that need the first pose unchanged transform the result afterwards."""


class ScanEquations(NamedTuple):
    """The scans' part of the equations of their poses, the surfels' offsets and slopes eliminated."""

    diagonal: NDArray[np.float64]
    """Diagonal blocks, (scans, 3, 3)."""
    gradient: NDArray[np.float64]
    """Gradient, (scans, 3)."""
    observations: SurfelObservations
    """The blocks between scans and surfels."""
    normal: NDArray[np.float64]
    """Normals of the surfels, once for their offsets and once for their slopes, (2 surfels, 2)."""
    total: NDArray[np.float64]
    """Precisions of offsets [1/m^2] and slopes [1/rad^2], the poses held, (2 surfels,)."""
    noise: Noise
    """Noise of the end points as they lie about these surfels."""


class SeenWalls(NamedTuple):
    """End points and the surfels that they lie on."""

    points: NDArray[np.float64]
    """End points in the map's frame [m], (n, 2)."""
    matches: Matches
    """Which surfel each belongs to."""
    normal: NDArray[np.float64]
    """Unit normals of the surfels' lines, (surfels, 2)."""
    total: NDArray[np.float64]
    """Precisions of offsets [1/m^2] and slopes [1/rad^2], (2 surfels,)."""
    noise: Noise
    """Noise of the end points as they lie about these surfels."""


class Adjustment:
    """The equations of a recording: scans that see the same surfels, and odometry between neighbours."""

    def __init__(
        self, odometry: se2.Pose, cloud: Cloud, with_scan: NDArray[np.int64], config: RefineConfig, threads: Threads
    ) -> None:
        """odometry (frames, 3): `T_odom_robot`;  with_scan (scans,): frames to which the cloud's scans belong."""
        self.cloud, self.with_scan, self.config, self.threads = cloud, with_scan, config, threads
        motions = se2.between(odometry[:-1], odometry[1:])
        self.calibration = OdometryCalibration(motions)
        self.prior = motion_prior(motions, config.motion)
        self.found_noise = INITIAL  # as the last step saw it
        self.noise = INITIAL  # with which the next step weighs end points, see `for_weights`
        self.odometry_variance = np.ones(2)
        self.solved: JointEquations  # of the last step
        self.seen: NDArray[np.float64]  # information of each scan about its pose there, the walls held, (scans, 3, 3)

    def step(self, poses: se2.Pose, gate: float) -> se2.Pose:
        """Gauss-Newton step (frames, 3) to be added to poses (frames, 3); see `match_points` for the gate [m]."""
        vars(self).pop("solved", None)  # the equations of the step before, whose memory this one needs
        n, k = len(poses), self.with_scan
        diagonal, coupling, gradient = np.zeros((n, 3, 3)), np.zeros((n - 1, 3, 3)), np.zeros((n, 3))
        self.calibration.follow(poses)
        motions, calibration = self.calibration.motions(), self.calibration.equations(self.prior, poses)
        add_odometry_steps(self.prior, poses, motions, diagonal, coupling, gradient)
        diagonal[0] += np.eye(3) * GAUGE
        scans = self.scan_equations(poses[k], gate)
        gradient[k] += scans.gradient
        diagonal[k] += scans.diagonal
        self.seen = scans.diagonal

        system = JointEquations(
            Equations(
                poses=poses.copy(),
                with_scan=k,
                diagonal=diagonal,
                coupling=coupling,
                calibration=calibration,
                observations=scans.observations,
                normal=scans.normal,
                total=scans.total,
            )
        )
        factor = variance_factors(self.prior, poses, motions, system.factors, system.eliminated)
        self.prior = with_variances(self.prior, *factor)  # this and the noise are for the next step
        self.found_noise, self.noise = scans.noise, for_weights(scans.noise)
        self.odometry_variance *= factor
        moved = system.solve(np.vstack([gradient, calibration.gradient]))
        self.calibration.move(moved[-1])
        self.solved = system
        return moved[:-1]

    def scan_equations(self, poses: se2.Pose, gate: float) -> ScanEquations:
        """Find the surfels at poses (scans, 3) and set up the scans' part of the equations."""
        seen = self._seen_walls(poses, gate)  # all else that it takes to find them is forgotten
        first, scans, surfels = self.cloud.first, len(poses), len(seen.normal)
        count = np.empty(scans, np.int64)
        self.threads.run(count_surfels, scans, first, seen.matches.surfel, surfels, count)
        begins = np.concatenate([[0], np.cumsum(2 * count)])  # an offset and a slope each
        columns = (np.empty(begins[-1]) for _ in range(3))
        observations = SurfelObservations(begins, np.empty(begins[-1], np.int32), *columns)
        diagonal, gradient = np.zeros((scans, 3, 3)), np.zeros((scans, 3))
        found = seen.points, seen.matches, seen.normal
        self.threads.run(collect, scans, first, poses, *found, diagonal, gradient, observations)
        return ScanEquations(diagonal, gradient, observations, np.tile(seen.normal, (2, 1)), seen.total, seen.noise)

    def _seen_walls(self, poses: se2.Pose, gate: float) -> SeenWalls:
        """Find the surfels at poses (scans, 3) and the end points that lie on them."""
        cloud, config, noise, threads = self.cloud, self.config, self.noise, self.threads
        n = len(cloud.ends)
        there = transform_cloud(cloud, poses, threads)
        reach = config.spacing + gate + GATE_SIGMAS * float(np.sqrt(noise.floor + noise.shared))
        cells, cell_of, surfels = self.walls(there, reach)
        matches = Matches(np.empty(n, np.int32), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
        settings = noise, self.found_noise, config.spacing, gate
        threads.run(match_points, n, there, cloud.ranges, cells, cell_of, surfels, *settings, matches)
        normal, total = surfels.normal.copy(), np.empty(2 * len(surfels.point))
        surplus = noise.floor - self.found_noise.floor
        weigh_points(matches, cloud.first, cloud.each, gate, noise.shared, surplus, normal, total)
        observed = cloud.first, matches.surfel, matches.across, cloud.ranges, there.view_directions, normal
        return SeenWalls(there.points, matches, normal, total, estimate_noise(*observed, before=noise))

    def walls(self, there: PlacedCloud, reach: float) -> tuple[Cells, NDArray[np.int32], Surfels]:
        """Cells of the cloud that lies `there`, the cell of each end point (n,), and the surfels, listed for the
        cells within `reach` [m]."""
        config = self.config
        cells, cell_of = make_cells(there.points, config.cell)
        noises = self.noise, self.found_noise
        return cells, cell_of, find_surfels(there, self.cloud, cells, cell_of, config, noises, reach, self.threads)
