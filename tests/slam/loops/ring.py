# SPDX-License-Identifier: MIT
"""A ring of corridors with exact scans: the smallest building with a loop."""

import numpy as np

from slam import FilterConfig, se2
from slam.sensor.rays import make_rays
from tests.slam.rooms import closed, scan_at

OUTER = closed(
    np.array([(0.0, 0.0), (5.0, 0.0), (5.0, -1.0), (6.5, -1.0), (6.5, 0.0), (14.0, 0.0), (14.0, 9.0), (0.0, 9.0)])
)
INNER = closed(
    np.array([(2.2, 2.0), (12.0, 2.0), (12.0, 6.8), (8.0, 6.8), (8.0, 6.2), (7.0, 6.2), (7.0, 6.8), (2.2, 6.8)])
)
WALLS = np.vstack([OUTER, INNER])
LAP = np.array([(1.1, 1.0), (13.0, 1.0), (13.0, 7.9), (1.1, 7.9)])
STEP = 0.2


def lap(length):
    """True poses (n, 3) along the middle of the corridors, `length` [m], with turns on the spot at the corners."""
    poses, leg, at, heading = [], 0, LAP[0], 0.0
    while len(poses) * STEP < length:
        target = LAP[(leg + 1) % len(LAP)]
        for share in np.arange(0.0, 1.0, STEP / np.linalg.norm(target - at)):
            poses.append((*(at + share * (target - at)), heading))
        poses += [(*target, heading + turn) for turn in np.arange(0.15, np.pi / 2, 0.15)]
        at, leg, heading = target, leg + 1, heading + np.pi / 2
    return np.array([(x, y, se2.wrap_angle(theta)) for x, y, theta in poses])


def rays_at(poses, walls=WALLS):
    """Rays of a scan at each pose, by the number of the pose."""
    usable = FilterConfig().map.usable_range
    return {k: make_rays([scan_at(pose, beams=180, walls=walls)], usable_range=usable) for k, pose in enumerate(poses)}


def drifting(poses, scale, heading):
    """Poses as a robot would add them up whose wheels count by `scale` too far and turn by `heading` [rad/m]."""
    motions = se2.between(poses[:-1], poses[1:])
    length = np.hypot(motions[:, 0], motions[:, 1])
    motions[:, :2] *= scale
    motions[:, 2] += heading * length
    out = [poses[0]]
    for motion in motions:
        out.append(se2.compose(out[-1], motion))
    return np.array(out)
