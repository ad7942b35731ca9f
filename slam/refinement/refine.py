# SPDX-License-Identifier: MIT
"""The final pass over a recording: the whole trajectory and the walls that it saw, estimated together.

The filter decides once and for all at every scan; after the run the chosen trajectory can be re-estimated with all
scans in view. Loops that it left open are closed first (`slam.loops`). Then two steps alternate: short pieces of wall
(surfels) are found where end points of many scans lie; then all poses make one Gauss-Newton step towards the optimum of

    min_{x,o}  1/2 sum_i rho((n_e . p_i(x) - o_e)^2 / sigma_i^2)  -  sum_t log p(x_t+1 | x_t, u_t),

end points p_i against the lines of their surfels, whose offsets o_e and slopes follow, under a bounded loss rho, and
odometry between neighbours. How much each end point and each step of the odometry counts is estimated from the
recording (`slam.refinement.noise`, `odometry_noise`), and the odometry is calibrated (`odometry_calibration`); the end
points of a scan on a surfel share a part of their error. Holding the walls while the poses move, and the poses while
the walls are drawn, would need many more rounds.
Poses of frames without a scan take part through their odometry, so the result has a pose at every frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam._threads import Threads
from slam.config import FilterConfig
from slam.loops import LoopClosing, close_loops
from slam.occupancy import OccupancyGrid
from slam.refinement.blind_stretches import along_odometry, blind_steps
from slam.refinement.bundle_adjustment import Adjustment
from slam.refinement.covariance import pose_covariances
from slam.refinement.noise import Noise
from slam.refinement.progress import LOOPS_SHARE, ROUNDS_SHARE, Watch, WatchedScans, unwatched
from slam.refinement.redraw_map import max_snap_distance, redraw_map
from slam.refinement.scan_frames import ScanLayout
from slam.refinement.surfels import make_cloud, transform_cloud
from slam.scan import Scan

ROUNDS_AFTER = 2
"""Rounds of the adjustment after bent scans were laid out anew."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Refined:
    """Result of the final pass."""

    poses: se2.Pose
    """Poses of all frames in the map's frame, (frames, 3)."""
    covariances: NDArray[np.float64]
    """Covariances of the poses along the axes of the map, relative to the first pose, (frames, 3, 3)."""
    map: OccupancyGrid
    """Map of all scans, each at its refined pose."""
    closing: LoopClosing | None
    """The loops that were found before the adjustment; None where they were not looked for."""
    noise: Noise
    """How far end points err, as estimated from the recording."""
    odometry_variance: tuple[float, float]
    """Factors on the variances of position and heading in `RefineConfig.motion`, as estimated from the recording."""
    odometry_correction: NDArray[np.float64]
    """By how much distances and angles that the odometry counts are to be increased, as shares, and by how much its
    heading per metre [rad/m], (3,); see `slam.refinement.odometry_calibration`."""
    odometry_correction_sigma: NDArray[np.float64]
    """Standard deviations of these, (3,)."""
    rounds: int
    """Rounds of the adjustment that were made: fewer than `RefineConfig.rounds` where the pass was ended before."""
    blind: NDArray[np.bool_]
    """Whether each step between frames is in a stretch on which no scan tells how far the robot came, (frames - 1,)."""

    def along_odometry(self, odometry: se2.Pose) -> se2.Pose:
        """The path with the distances of the odometry (frames, 3), as corrected, on the blind steps, (frames, 3): from
        it another pass may find a path that agrees better with the odometry."""
        motions = (1.0 + self.odometry_correction[0]) * se2.between(odometry[:-1], odometry[1:])
        return along_odometry(self.poses, motions, self.blind)

    def __repr__(self) -> str:
        """One line, for notebooks."""
        loops = "not looked for" if self.closing is None else f"{int(self.closing.accepted.sum())} closed"
        return f"<Refined: {len(self.poses)} poses, loops {loops}, {self.rounds} rounds, {self.map}>"


def refine(
    odometry: se2.Pose,
    scans: Sequence[Scan | None],
    initial: se2.Pose,
    config: FilterConfig,
    *,
    twists: Sequence[NDArray[np.float64] | None] | None = None,
    stamps: NDArray[np.float64] | None = None,
    threads: int | None = None,
    watch: Watch = unwatched,
) -> Refined:
    """Refine a trajectory and its map.

    odometry (frames, 3): `T_odom_robot`;  scans: one per frame or None;  initial (frames, 3): poses to begin from
    twists: velocity (3,) of the robot while each scan was taken, None where it is unknown; they can be left out only
    where no scan tells the times of its beams. `slam.Recording` keeps all of these while it feeds a filter
    stamps (frames,): increasing times of the frames [s]; with them a scan is seen from the frame nearest to the middle
    of its sweep, without them from its own
    watch: is told how far the pass has come; where it returns False, no further round is begun after the first, and the
    result is what the rounds so far have made

    Raises:
        ValueError: the lengths differ, a pose is not finite, no frame has a scan with a hit, or scans tell the times
            of their beams and no twists came: the motion within the scans would remain in them, unnoticed.
    """
    n = len(odometry)
    if len(scans) != n or len(initial) != n or (twists is not None and len(twists) != n):
        raise ValueError(f"odometry, scans and initial must be of one length, got {n}, {len(scans)}, {len(initial)}")
    odometry = np.asarray(odometry, dtype=np.float64)
    if not (np.isfinite(odometry).all() and np.isfinite(initial).all()):
        raise ValueError("odometry and initial must be finite")
    if twists is None and config.deskew and any(scan is not None and scan.has_beam_times for scan in scans):
        raise ValueError(
            "the scans have time_offsets, but twists are missing: pass twists=, a velocity (vx, vy, omega) or None for "
            "each frame, or feed the filter by slam.Recording, which keeps them"
        )
    layout = ScanLayout(scans, stamps, twists if config.deskew else None, config)
    seen = layout.with_hits()
    if not seen:
        raise ValueError("no frame has a scan with a hit: nothing to refine")
    workers, settings = Threads(threads), config.refine
    cloud = make_cloud(seen.values(), settings.max_points)
    adjustment = Adjustment(odometry, cloud, np.fromiter(seen, np.int64), settings, workers)
    closing = None
    if settings.close_loops:
        closing = close_loops(odometry, initial, WatchedScans(seen, watch, 0.0, LOOPS_SHARE), config, workers)
    poses = np.array(initial if closing is None else closing.path, dtype=np.float64)
    goes_on, rounds = True, 0
    while goes_on and rounds < settings.rounds:
        gate = max(settings.first_gate * settings.gate_decay**rounds, settings.last_gate)
        poses, rounds = _moved(poses, adjustment.step(poses, gate)), rounds + 1
        goes_on = watch(LOOPS_SHARE + ROUNDS_SHARE * rounds / settings.rounds)
    if goes_on and (straightened := layout.straighten(poses)) is not None:
        poses, cloud = straightened, make_cloud(seen.values(), settings.max_points)
        adjustment.cloud = cloud
        for _ in range(ROUNDS_AFTER):
            poses = _moved(poses, adjustment.step(poses, settings.last_gate))
    # The first pose defines the frame, but it errs as any other: it moves with them, then the whole is moved back.
    poses = se2.compose(se2.compose(initial[0], se2.inverse(poses[0])), poses)
    cells, _, surfels = adjustment.walls(
        transform_cloud(cloud, poses[adjustment.with_scan], workers), max_snap_distance(settings, adjustment.noise)
    )
    drawn_from = WatchedScans(layout, watch, LOOPS_SHARE + ROUNDS_SHARE, 1.0)
    drawn = redraw_map(poses, drawn_from, (cells, surfels), adjustment.noise, config, workers)
    position, heading = adjustment.odometry_variance.tolist()
    solved = adjustment.solved.equations
    return Refined(
        poses=poses,
        covariances=_turned(pose_covariances(solved), poses[0, 2] - solved.poses[0, 2]),
        map=drawn,
        closing=closing,
        noise=adjustment.found_noise,
        odometry_variance=(position, heading),
        odometry_correction=adjustment.calibration.values,
        odometry_correction_sigma=np.sqrt(np.diag(adjustment.solved.calibration_covariance())),
        rounds=rounds,
        blind=blind_steps(solved, adjustment.seen),
    )


def _moved(poses: se2.Pose, step: NDArray[np.float64]) -> se2.Pose:
    """Poses (n, 3) after a step (n, 3)."""
    moved = poses + step
    moved[:, 2] = se2.wrap_angle(moved[:, 2])
    return moved


def _turned(covariances: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Covariances (n, 3, 3) along axes that were turned by an angle [rad]."""
    R = se2.rotation(np.array(angle))
    turned: NDArray[np.float64] = R @ covariances @ R.T
    return turned
