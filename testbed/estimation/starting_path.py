# SPDX-License-Identifier: MIT
"""Where the final pass begins: at the filter's path or, where scans say too little, perhaps at one of the odometry.

Where a scan says nothing, the filter's particles spread as far as its motion model allows, which is far more than most
odometries err in a step, and the best of them is a random walk. The final pass estimates how far the odometry errs;
from the odometry's path it comes near the truth, from a random walk it does not. So where the sensors see too little,
or the scans of a stretch (a bare corridor), it is made from both, and the one counts under which scans and odometry
together are likelier.

How far the odometry errs is found by expectation maximisation, one step a round, and slowly where scans say little: of
a lidar with a reach of 1 m the variance of the heading stands at 0.48 of the motion model's after 6 rounds, at 0.14
after 24, and still falls (office, seed 4). So the pass is given more rounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from slam import se2
from slam.config import FilterConfig
from slam.config.refinement import MAX_ROUNDS
from slam.diagnosis.path_check import left_out_score
from slam.motion.odometry_model import MotionPrior, motion_prior
from slam.refinement import Refined
from slam.refinement.odometry_noise import with_variances
from slam.scan import Scan
from slam.se2 import Pose
from slam.sensor.rays import make_rays
from testbed.frame import Frame
from testbed.weak_sensors import shortcomings, view_of

MORE_ROUNDS = 4
"""So many times as many rounds of the final pass are made for such sensors."""
NO_SCAN = Scan(ranges=np.empty(0), angles=np.empty(0), range_max=1.0, stamp=0.0)


def what_is_lacking(frames: Sequence[Frame], config: FilterConfig) -> list[str]:
    """Say what the lidar lacks that comes nearest to carrying a map; empty where one of them can."""
    scans: dict[str, Scan] = {}
    for frame in frames:
        if frame.scan is not None and len(frame.scan.angles) > len(scans.get(frame.lidar, NO_SCAN).angles):
            scans[frame.lidar] = frame.scan
    lacking = [
        shortcomings(view_of(scan.angles), len(scan.angles), min(scan.range_max, config.map.usable_range))
        for scan in scans.values()
    ]
    return min(lacking, key=len, default=[])


def with_more_rounds(config: FilterConfig) -> FilterConfig:
    """The settings with as many rounds of the final pass as such sensors need."""
    rounds = min(MORE_ROUNDS * config.refine.rounds, MAX_ROUNDS)
    return replace(config, refine=replace(config.refine, rounds=rounds))


class Start(NamedTuple):
    """Another path from which the final pass is made."""

    path: Pose
    """Poses of the frames, (frames, 3)."""
    reason: str
    """Why the filter's path may not do, as the beginning of a sentence."""
    name: str
    """What the path is, as a part of a sentence."""

    def note(self, *, chosen: bool) -> str:
        """Return the sentence about it for the notes of a run."""
        begin = f"{self.name}, under which scans and odometry are likelier" if chosen else "the filter's path"
        return f"final pass: {self.reason}: it began at {begin}"


def another_start(
    result: Refined, path: Pose, odometry: Pose, frames: Sequence[Frame], config: FilterConfig
) -> Start | None:
    """Return another path to begin from, where the scans leave one open.

    result: of the final pass from the filter's path (frames, 3);  odometry (frames, 3)
    """
    if lacking := what_is_lacking(frames, config):
        by_odometry = se2.compose(path[0], se2.between(odometry[0], odometry))
        return Start(by_odometry, f"a lidar with {' and '.join(lacking)} can hardly carry a map", "the odometry's path")
    if result.blind.any():
        steps = np.hypot(*(odometry[1:, :2] - odometry[:-1, :2])[result.blind].T)
        reason = f"on {steps.sum():.0f} m of the way no scan tells how far the robot came"
        return Start(result.along_odometry(odometry), reason, "a path that follows the odometry there")
    return None


def likelier(
    results: Sequence[Refined],
    odometry: Pose,
    frames: Sequence[Frame],
    updates: NDArray[np.intp],
    config: FilterConfig,
) -> int:
    """Return which of several results of the final pass is the likeliest.

    odometry (frames, 3);  updates: frames whose scans are compared. The odometry is judged with the same variances
    under all results, the geometric mean of theirs: each alone has not yet found its own after so few rounds.
    """
    variances = np.exp(np.mean([np.log(result.odometry_variance) for result in results], axis=0))
    motions = se2.between(odometry[:-1], odometry[1:])
    prior = with_variances(motion_prior(motions, config.motion), *variances.tolist())
    logs = [
        _log_likelihood_of_scans(result, frames, updates, config)
        + log_likelihood_of_steps(prior, motions, result.poses)
        for result in results
    ]
    return int(np.argmax(logs))


def _log_likelihood_of_scans(
    result: Refined, frames: Sequence[Frame], updates: NDArray[np.intp], config: FilterConfig
) -> float:
    """Log-likelihood [nats] of beams kept out of the map, each with the weight that beams have in the filter."""
    rays = [
        make_rays([scan], usable_range=config.map.usable_range, twist=frames[row].twist if config.deskew else None)
        for row in updates.tolist()
        if (scan := frames[row].scan) is not None
    ]
    score = left_out_score(result.poses[updates], rays, config.map)
    return 0.0 if score is None else score * config.match.beam_weight * sum(int(ray.hit.sum()) for ray in rays)


def log_likelihood_of_steps(prior: MotionPrior, motions: Pose, poses: Pose) -> float:
    """Log-likelihood [nats] of the odometry's steps motions (steps, 3) under a path (steps + 1, 3): a mixture.

    prior: of all steps. Steps in which the odometry failed, or the robot jumped, are charged what they cost.
    """
    error = se2.between(motions, se2.between(poses[:-1], poses[1:]))
    squared = np.einsum("scr,sr->sc", prior.precision, error**2)
    return float(logsumexp(prior.log_scale - 0.5 * squared, axis=1).sum())
