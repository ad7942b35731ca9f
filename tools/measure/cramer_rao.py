# SPDX-License-Identifier: MIT
"""Compare the error of the final path with the Cramer-Rao bound of the same data: no estimator errs less.

    python -m tools.measure.cramer_rao [--worlds long_corridor,hall,courtyard] [--seeds 530:532]

Writes: docs/consistency.md (bound)

The bound takes into account what the simulator knows: each beam that met a straight piece of wall, with its true noise
across the wall; odometry with its true noise; and what is unknown besides the poses: offset and direction of every
piece of wall, and the systematic errors of the wheels, of which the spread over robots is known (the Bayesian bound of
Van Trees 1968, section 2.4.3). That readings carry less where they meet edges, that ticks are whole, that walls are not
known to be straight from end to end, and which reading belongs to which wall, is left out; so the bound is lower than
what can be reached. The second bound is that of the readings away from corners: those nearer to an end of their wall
than the final pass takes (`CORNER_SIGMAS` in slam/refinement) are left out. Where it is much larger, such readings are
what tells how far the robot came.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import worlds
from slam import se2
from slam.config import FilterConfig, MotionConfig
from slam.motion.odometry_model import MotionPrior, motion_prior
from slam.refinement._chain_kernels import (
    add_calibration,
    add_odometry_steps,
    chain_covariances,
    factor_chain,
    solve_chain,
)
from slam.refinement._surfel_match_kernels import CORNER_SIGMAS
from slam.refinement.odometry_calibration import basis_of
from testbed.estimation.estimation import Estimation
from testbed.frame import Frame
from testbed.presets import LidarPreset
from testbed.seeds import RunSeeds
from testbed.simulation import OdometryConfig, SimulationConfig, simulate
from testbed.simulation.robot.odometry import GRADES
from tools.pages import DOCS, write_table
from worlds.raster import drawn_walls

PAGE = DOCS / "consistency.md"
HELD = 1e12
"""Precision of the first pose, relative to which errors are looked at [1/m^2, 1/rad^2]."""
FREE = 1e-6
"""Precision of a wall's offset and direction before any data [1/m^2, 1/rad^2]."""
LEAST = 1e-5
"""Least standard deviation of a step of odometry [m, rad]: across the way, and at rest."""
DRIFT_SIGMA = 0.003
"""Standard deviation of the drift of `typical` odometry [rad/m]: wheels unequal by 3 % of 2 %, a track of 0.23 m."""
SAME = 0.1
"""A reading that differs by more from the true range [m], and by five standard deviations, met something else."""


class Beams(NamedTuple):
    """The beams of all scans that met a wall."""

    pose: NDArray[np.int64]
    """Number of the pose from which each was taken, (n,)."""
    wall: NDArray[np.int64]
    """Number of the wall that it met, (n,)."""
    end: NDArray[np.float64]
    """Where it met it [m], (n, 2)."""
    weight: NDArray[np.float64]
    """1 / variance of its end across the wall [1/m^2], (n,)."""
    from_corner: NDArray[np.float64]
    """Distance of its end from the nearest end of the wall, by the standard deviation of its range, (n,)."""

    def away_from_corners(self) -> Beams:
        """Those that the final pass may take."""
        away = self.from_corner >= CORNER_SIGMAS
        return Beams(self.pose[away], self.wall[away], self.end[away], self.weight[away], self.from_corner[away])


def bound(
    poses: se2.Pose, prior: MotionPrior, beams: Beams, walls: NDArray[np.float64], spread: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Smallest covariances (n, 3, 3) of poses (n, 3), relative to the first, along the axes of the world.

    prior: precisions of the steps between them;  walls (m, 4): segments [m]
    spread (3,): standard deviations of the odometry's systematic errors, as `odometry_calibration.SIGMA`
    """
    n, m, motions = len(poses), len(walls), se2.between(poses[:-1], poses[1:])
    diagonal, coupling, gradient = np.zeros((n, 3, 3)), np.zeros((n - 1, 3, 3)), np.zeros((n, 3))
    add_odometry_steps(prior, poses, motions, diagonal, coupling, gradient)
    C, K, gradient_of_wheels = np.zeros((n, 3, 3)), np.diag(spread**-2.0), np.zeros(3)
    add_calibration(prior, poses, motions, basis_of(motions), C, K, gradient_of_wheels)
    diagonal[0] += HELD * np.eye(3)
    to_walls, of_walls = _add_beams(poses, beams, walls, diagonal)
    unknowns = np.concatenate([C, to_walls], axis=2)
    precision = np.zeros((3 + 2 * m, 3 + 2 * m))
    precision[:3, :3], precision[3:, 3:] = K, of_walls
    factors, eliminated = np.empty((n, 3, 3)), np.empty((n - 1, 3, 3))
    if not factor_chain(diagonal, coupling, factors, eliminated):
        raise FloatingPointError("the information of the poses is not positive definite")
    follows = np.empty_like(unknowns)  # of the poses, by the unknowns
    for k in range(unknowns.shape[2]):
        column = np.empty((n, 3))
        solve_chain(factors, eliminated, coupling, np.ascontiguousarray(unknowns[:, :, k]), column)
        follows[:, :, k] = column
    rest = np.linalg.inv(precision - np.einsum("nik,nil->kl", unknowns, follows))
    covariances = np.empty((n, 3, 3))
    chain_covariances(factors, eliminated, covariances)
    least: NDArray[np.float64] = covariances + follows @ rest @ follows.swapaxes(1, 2)
    return least


def _add_beams(
    poses: se2.Pose, beams: Beams, walls: NDArray[np.float64], diagonal: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Add the information of the beams to diagonal (n, 3, 3); returns the blocks between poses and the offsets and
    directions of the walls, (n, 3, 2 m), and that of the walls, (2 m, 2 m)."""
    along = walls[:, 2:] - walls[:, :2]
    along /= np.hypot(*along.T)[:, None]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    seen, lever = normal[beams.wall], beams.end - poses[beams.pose, :2]
    turned = seen[:, 1] * lever[:, 0] - seen[:, 0] * lever[:, 1]
    J = np.column_stack([seen, turned])  # derivatives of the distance of the end from its wall, by the pose
    apart = np.einsum("ni,ni->n", along[beams.wall], beams.end - 0.5 * (walls[:, :2] + walls[:, 2:])[beams.wall])
    G = -np.column_stack([np.ones(len(apart)), apart])  # by offset and direction of the wall
    np.add.at(diagonal, beams.pose, beams.weight[:, None, None] * J[:, :, None] * J[:, None, :])
    to_walls = np.zeros((len(poses), 3, 2 * len(walls)))
    of_walls = FREE * np.eye(2 * len(walls))
    for k in range(2):
        at = 2 * beams.wall + k
        np.add.at(to_walls.swapaxes(1, 2), (beams.pose, at), (beams.weight * G[:, k])[:, None] * J)
        for j in range(2):
            np.add.at(of_walls, (at, 2 * beams.wall + j), beams.weight * G[:, k] * G[:, j])
    return to_walls, of_walls


def true_steps(motions: se2.Pose, config: OdometryConfig) -> MotionPrior:
    """The noise of odometry as it is simulated, for displacements (n, 3)."""
    prior = motion_prior(motions, MotionConfig(failure_share=0.0, jump_share=0.0))
    distance, turn = np.hypot(motions[:, 0], motions[:, 1]), np.abs(motions[:, 2])
    precision = prior.precision.copy()
    precision[:, 0, 0] = 1.0 / (config.random_translation**2 * distance + LEAST**2)
    precision[:, 0, 1] = LEAST**-2.0
    precision[:, 0, 2] = 1.0 / (config.random_rotation**2 * (distance + turn) + LEAST**2)
    return prior._replace(precision=precision)


def seen_beams(frames: list[Frame], walls: NDArray[np.float64], lidar: LidarPreset) -> Beams:
    """The beams of frames with a scan, as cast from their true poses at walls (m, 4)."""
    parts = []
    for number, frame in enumerate(frames):
        scan, truth = frame.scan, frame.truth
        assert scan is not None
        assert truth is not None
        at = se2.compose(truth, np.array(scan.mount))
        ranges, wall = cast(at, scan.angles, walls)
        sigma = np.maximum(lidar.noise_floor, lidar.noise_share * ranges)
        met = scan.hit & np.isfinite(ranges) & (np.abs(scan.ranges - ranges) < SAME + 5.0 * sigma)
        direction = np.stack([np.cos(at[2] + scan.angles), np.sin(at[2] + scan.angles)], axis=1)[met]
        w, r = walls[wall[met]], ranges[met]
        along = (w[:, 2:] - w[:, :2]) / np.hypot(*(w[:, 2:] - w[:, :2]).T)[:, None]
        cosine = direction[:, 0] * along[:, 1] - direction[:, 1] * along[:, 0]
        across = np.hypot(sigma[met] * cosine, np.radians(lidar.angle_noise_deg) * r * np.sqrt(1.0 - cosine**2))
        end = at[:2] + r[:, None] * direction
        from_end = np.minimum(np.hypot(*(end - w[:, :2]).T), np.hypot(*(end - w[:, 2:]).T))
        parts.append((np.full(len(r), number), wall[met], end, across**-2.0, from_end / sigma[met]))
    return Beams(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def cast(
    lidar: se2.Pose, angles: NDArray[np.float64], walls: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Ranges (beams,) to the nearest wall [m], inf where there is none, and its number; lidar (3,), walls (m, 4)."""
    direction = np.stack([np.cos(lidar[2] + angles), np.sin(lidar[2] + angles)], axis=1)[:, None]
    along, begin = walls[:, 2:] - walls[:, :2], walls[:, :2] - lidar[:2]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = direction[..., 0] * along[:, 1] - direction[..., 1] * along[:, 0]
        ranges = (begin[:, 0] * along[:, 1] - begin[:, 1] * along[:, 0]) / across
        share = (begin[:, 0] * direction[..., 1] - begin[:, 1] * direction[..., 0]) / across
        ranges = np.where((ranges > 0.0) & (share >= 0.0) & (share <= 1.0), ranges, np.inf)
    nearest = ranges.argmin(axis=1)
    return ranges[np.arange(len(angles)), nearest], nearest


def error_and_bounds(world: str, seed: int) -> tuple[float, float, float]:
    """Root mean square errors of position [m] over a drive, relative to the first pose: of the final path, the least
    that is possible, and the least without readings near corners."""
    seeds, loaded = RunSeeds.from_seed(seed), worlds.load(world)
    estimation = Estimation(FilterConfig(particles=2), seeds.filter, threads=1)
    config = SimulationConfig(backend="fast", seeds=seeds)
    frames = []
    with simulate(loaded, config) as simulation:
        for frame in simulation:
            estimation.process(frame)
            if frame.scan is not None:
                frames.append(frame)
    refined = estimation.refined(estimation.filtered()).at_scans.poses
    truth = np.array([frame.truth for frame in frames])
    walls = drawn_walls(loaded, config.robot.lidar_mount.height)
    prior = true_steps(se2.between(truth[:-1], truth[1:]), config.odometry)
    grade = GRADES[config.odometry.grade]
    spread = np.array([grade.distance, grade.rotation, DRIFT_SIGMA])
    beams = seen_beams(frames, walls, config.lidar)
    least, away = (_root_mean_square(bound(truth, prior, b, walls, spread)) for b in (beams, beams.away_from_corners()))
    off = se2.between(refined[0], refined)[:, :2] - se2.between(truth[0], truth)[:, :2]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1)))), least, away


def _root_mean_square(covariances: NDArray[np.float64]) -> float:
    """Error of position [m] of covariances (n, 3, 3)."""
    return float(np.sqrt(np.mean(covariances[:, 0, 0] + covariances[:, 1, 1])))


def row(world: str, drives: list[tuple[float, float, float]]) -> str:
    """One line of the table: errors and bounds [m] of the drives, as root mean squares."""
    error, least, away = np.sqrt(np.mean(np.square(drives), axis=0)).tolist()
    ratios = [mine / possible for mine, possible, _ in drives]
    within = f"{min(ratios):.1f} to {max(ratios):.1f}"
    lengths = f"{1e3 * error:.1f} mm | {1e3 * least:.1f} mm | {1e3 * away:.1f} mm"
    return f"| {world} | {len(drives)} | {lengths} | {error / least:.2f} | {within} |"


def main() -> None:
    """Make the drives and write the table into the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", default="long_corridor,hall,courtyard")
    parser.add_argument("--seeds", default="530:532", help="first seed and the one after the last")
    args = parser.parse_args()
    seeds = range(*map(int, args.seeds.split(":")))
    rows = [row(world, [error_and_bounds(world, seed) for seed in seeds]) for world in args.worlds.split(",")]
    head = "| world | drives | error | bound | away from corners | error / bound | of the drives |"
    write_table(PAGE, "bound", "\n".join([head, "|---|---|---|---|---|---|---|", *rows]))


if __name__ == "__main__":
    main()
