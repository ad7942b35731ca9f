# SPDX-License-Identifier: MIT
"""The self-check of an estimate: its scans are compared with the maps that the other scans draw; no truth is needed.

While the filter drives, `compare_scan` compares each scan with the map before the scan is counted into it. A finished
path is checked by drawing its map once more, scan by scan (`check_path`): each scan is predicted from those before it
(Dawid, "The Prequential Approach", J. R. Statist. Soc. A 147, 1984).

`left_out_score` tells which of two estimates of one recording is better: every k-th beam is kept out of the map and
predicted from the rest. The mean of its log-likelihood is a proper score (Gneiting, Raftery 2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam._threads import Threads
from slam.config import FilterConfig, MapConfig
from slam.diagnosis._beam_kernels import beam_log_likelihoods
from slam.diagnosis.beam_check import check_scan
from slam.diagnosis.contradiction import ContradictionMonitor, ScanEvidence, is_jump, is_needless
from slam.diagnosis.unheld_directions import Hold
from slam.diagnosis.wheel_speed import WheelNews
from slam.grid.particle_maps import ParticleMaps
from slam.motion.odometry_model import MotionPrior, motion_prior
from slam.sensor.rays import Rays

KEPT_OUT = 8
"""Every k-th beam is kept out of the map; which ones changes from scan to scan."""
END_WINDOW = 0.1
"""A beam is predicted if it ends within this distance of where the map has it end [m]."""


class RangeModel(NamedTuple):
    """How a map predicts where a beam ends."""

    prior_hits: float = 0.02
    """Beams that are taken to have ended in a cell before any was counted."""
    prior_visits: float = 0.5
    """Beams that are taken to have reached it."""
    random_share: float = 0.05
    """Share of the beams that end anywhere: people, glass, mixed readings."""
    random_density: float = 0.005
    """Probability that such a beam ends within the window: 0.2 m of 40 m."""


class WheelStep(NamedTuple):
    """What the wheels say of the way from one scan of an estimate to the next."""

    motion: se2.Pose
    """Displacement (3,), seen from the robot."""
    prior: MotionPrior
    """Density of the true displacement about it."""
    news: WheelNews
    """What the speed of the wheels says of it."""


def compare_scan(
    maps: ParticleMaps, particle: int, rays: Rays, *, before: se2.Pose, step: WheelStep, pose: se2.Pose
) -> ScanEvidence:
    """Compare a scan with the map of a particle, which must not hold it yet.

    before (3,), pose (3,): where the estimate puts the robot at the scan before and at this one
    """
    predicted = se2.compose(before, step.motion)
    (beams, normals), displacement = check_scan(maps, particle, pose, rays), se2.between(predicted, pose)
    innovation = float(pose[0] - predicted[0]), float(pose[1] - predicted[1])
    variance = 1.0 / max(float(step.prior.precision[0, 0]), float(np.finfo(np.float64).tiny))
    hold = Hold(normals, innovation, variance, float(before[2]), step.news)
    if is_jump(displacement) and is_needless(check_scan(maps, particle, predicted, rays)[0]):
        return ScanEvidence(beams, displacement, hold)
    return ScanEvidence(beams, None, hold)


def check_path(
    stamps: NDArray[np.float64],
    poses: se2.Pose,
    odometry: se2.Pose,
    rays: Sequence[Rays],
    news: Sequence[WheelNews],
    config: FilterConfig,
) -> ContradictionMonitor:
    """Check a finished path: what a monitor has found at its end.

    stamps (scans,) [s];  poses (scans, 3): the estimate;  odometry (scans, 3): `T_odom_robot`;  rays: of each scan
    news: what the speed of the wheels says at each scan (`wheel_news`)

    Raises:
        ValueError: the lengths differ, or the map would grow beyond all bounds.
    """
    _require_one_length(stamps, poses, odometry, rays, news)
    maps, monitor = ParticleMaps(1, config.map, Threads(1)), ContradictionMonitor()
    for i, scan in enumerate(rays):
        if i > 0:
            motion = se2.between(odometry[i - 1], odometry[i])
            step = WheelStep(motion, motion_prior(motion, config.motion), news[i])
            evidence = compare_scan(maps, 0, scan, before=poses[i - 1], step=step, pose=poses[i])
            monitor.update(float(stamps[i]), poses[i], evidence)
        maps.integrate_scan(poses[i : i + 1], scan)
    return monitor


def left_out_score(poses: se2.Pose, rays: Sequence[Rays], config: MapConfig) -> float | None:
    """Mean log-likelihood of the beams that were kept out of the map [nats]; None if there is no such beam.

    poses (scans, 3): the estimate;  rays: of each scan. The higher, the better; it compares estimates of one recording
    only, since it depends on the place.

    Raises:
        ValueError: the lengths differ, or the map would grow beyond all bounds.
    """
    _require_one_length(poses, rays)
    maps = ParticleMaps(1, config, Threads(1))
    for i, scan in enumerate(rays):
        kept = np.arange(len(scan.hit)) % KEPT_OUT != i % KEPT_OUT
        if kept.any():
            maps.integrate_scan(poses[i : i + 1], Rays(*(np.ascontiguousarray(part[kept]) for part in scan)))
    found = [_log_likelihoods(maps, poses[i], scan, first=i % KEPT_OUT) for i, scan in enumerate(rays)]
    logs = np.concatenate([np.empty(0), *found])
    return float(logs.mean()) if len(logs) else None


def _log_likelihoods(maps: ParticleMaps, pose: se2.Pose, scan: Rays, *, first: int) -> NDArray[np.float64]:
    """Log-likelihoods (n,) of the hits of a scan among every `KEPT_OUT`-th beam from beam `first` on [nats]."""
    out = np.full(len(scan.hit), np.nan)
    pose, window = np.asarray(pose, dtype=np.float64), END_WINDOW / maps.config.cell
    beam_log_likelihoods(maps.grids, 0, pose, scan, KEPT_OUT, first, window, RangeModel(), out)
    logs: NDArray[np.float64] = out[~np.isnan(out)]
    return logs


def _require_one_length(*parts: Sequence[object] | NDArray[np.float64]) -> None:
    lengths = [len(part) for part in parts]
    if len(set(lengths)) > 1:
        raise ValueError(
            f"stamps, poses, odometry, rays and news must be of one length, got {', '.join(map(str, lengths))}"
        )
