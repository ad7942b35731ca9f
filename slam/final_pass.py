# SPDX-License-Identifier: MIT
"""The final pass over a recording: the whole trajectory and its map, made to agree.

The filter decides once and for all at every scan; after the run the chosen trajectory can be re-estimated with its
complete map in view. Two steps alternate: the map is drawn from all scans at the current poses; then all poses are
moved to the optimum of scans against that map and odometry between neighbours,

    min_x  sum_t cost(z_t | m, x_t)  -  sum_t log p(x_t+1 | x_t, u_t),

a chain whose Gauss-Newton equations are block tridiagonal. Poses of frames without a scan take part through their
odometry, so the result has a pose at every frame. It is a local refinement: loops that the filter left open stay open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam._chain_kernels import add_odometry_steps, scan_equations, solve_chain
from slam._match_kernels import BeamModel
from slam._ray_kernels import Rays
from slam.beams import rays_of
from slam.config import FilterConfig, MapConfig
from slam.motion import motion_prior
from slam.occupancy import OccupancyGrid
from slam.parallel import Threads
from slam.particle_maps import ParticleMaps
from slam.scan import Scan


@dataclass(frozen=True, kw_only=True, eq=False)
class Refined:
    """Result of the final pass."""

    poses: se2.Pose
    """Poses of all frames in the map's frame, (frames, 3)."""
    map: OccupancyGrid
    """Map of all scans, each at its refined pose."""


def refine(
    odometry: se2.Pose,
    scans: Sequence[Scan | None],
    initial: se2.Pose,
    config: FilterConfig,
    *,
    twists: Sequence[NDArray[np.float64] | None] | None = None,
    threads: int | None = None,
) -> Refined:
    """Refine a trajectory and its map.

    odometry (frames, 3): `T_odom_robot`;  scans: one per frame or None;  initial (frames, 3): poses to begin from
    twists: velocity (3,) of the robot while each scan was taken, or None

    Raises:
        ValueError: the lengths differ, or no frame has a scan with a hit.
    """
    n = len(odometry)
    if len(scans) != n or len(initial) != n or (twists is not None and len(twists) != n):
        raise ValueError(f"odometry, scans and initial must be of one length, got {n}, {len(scans)}, {len(initial)}")
    rays = {
        i: rays_of(
            [scan],
            usable_range=config.map.usable_range,
            free_range=config.map.free_range,
            twist=twists[i] if twists is not None and config.deskew else None,
        )
        for i, scan in enumerate(scans)
        if scan is not None
    }
    rays = {i: ray for i, ray in rays.items() if ray.hit.any()}
    if not rays:
        raise ValueError("no frame has a scan with a hit: nothing to refine")
    workers = Threads(threads)
    chain = _Chain(np.asarray(odometry, dtype=np.float64), rays, config, workers)
    crisp = replace(config.map, occupied_share=config.refine.occupied_share)
    start = np.array(initial, dtype=np.float64)
    for _ in range(config.refine.rounds):
        maps = _map_of(start, rays, crisp, workers)
        poses = start
        for _ in range(config.refine.iterations):
            poses = chain.improved(poses, maps)
        step = poses - start
        step[:, 2] = se2.wrap_angle(step[:, 2])
        if np.abs(step).mean(axis=0).max() < config.refine.settled:
            break
        # Map and poses hold each other back: one after the other they would creep to where both agree.
        start = start + config.refine.overshoot * step
    # Nothing held the first pose, which defines the frame of the map: the whole is moved back onto it. Had it been
    # held all along, map and other poses would have left it behind.
    poses = se2.compose(se2.compose(initial[0], se2.inverse(poses[0])), poses)
    return Refined(poses=poses, map=_map_of(poses, rays, config.map, workers).occupancy(0))


def _map_of(poses: se2.Pose, rays: dict[int, Rays], config: MapConfig, threads: Threads) -> ParticleMaps:
    """The map of all scans at given poses."""
    maps = ParticleMaps(1, config, threads)
    for i, ray in rays.items():
        maps.register(poses[i : i + 1], ray)
    return maps


class _Chain:
    """The equations of a whole trajectory: scans against a map, odometry between neighbours."""

    def __init__(self, odometry: se2.Pose, rays: dict[int, Rays], config: FilterConfig, threads: Threads) -> None:
        self.threads = threads
        self.motions = se2.between(odometry[:-1], odometry[1:])
        self.prior = motion_prior(self.motions, config.refine.motion)
        self.with_scan = np.fromiter(rays, np.int64)
        hits = [ray.ends[ray.hit] for ray in rays.values()]
        self.points = np.ascontiguousarray(np.concatenate(hits))
        self.first = np.concatenate([[0], np.cumsum([len(h) for h in hits])])
        self.model = BeamModel(
            per_sigma2=config.refine.hit_sigma**-2.0,
            per_outlier2=config.refine.outlier_distance**-2.0,
            weight=1.0,
            far=config.map.field_radius,
        )

    def improved(self, poses: se2.Pose, maps: ParticleMaps) -> se2.Pose:
        """Poses (frames, 3) after one Gauss-Newton step."""
        n, k = len(poses), self.with_scan
        diagonal, gradient = np.zeros((n, 3, 3)), np.zeros((n, 3))
        H, g, cost = np.zeros((len(k), 3, 3)), np.zeros((len(k), 3)), np.empty(len(k))
        self.threads.run(scan_equations, len(k), maps.grids, poses[k], self.first, self.points, self.model, H, g, cost)
        diagonal[k], gradient[k] = H, g
        diagonal[0] += np.eye(3) * 1e-2  # a step at all, where no scan holds the chain anywhere
        coupling = np.zeros((n - 1, 3, 3))
        add_odometry_steps(self.prior, poses, self.motions, diagonal, coupling, gradient)
        step = np.empty((n, 3))
        solve_chain(diagonal, coupling, gradient, step)
        moved = poses - step
        moved[:, 2] = se2.wrap_angle(moved[:, 2])
        return moved
