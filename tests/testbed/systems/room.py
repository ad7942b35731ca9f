# SPDX-License-Identifier: MIT
"""A short drive through a square room, with wheels that miss some of each step, and systems for it."""

from __future__ import annotations

import numpy as np

from slam import se2
from slam.scan import Scan
from testbed.frame import Frame

HALF = 4.0
"""Half the side of the room [m]."""


def frames(scans: int = 40, *, between: int = 2) -> list[Frame]:
    """A robot on a circle; its wheels count 2 % too much. So many frames without a scan lie between two scans."""
    angles = np.linspace(-np.pi, np.pi, 180, endpoint=False)
    step = np.array([0.06, 0.0, 0.04])
    truth, odometry, made = np.array([0.0, -1.5, 0.0]), np.zeros(3), []
    for k in range(scans * (between + 1)):
        scan = None
        if k % (between + 1) == 0:
            scan = Scan(ranges=ranges_from(truth, angles), angles=angles, range_max=20.0, stamp=0.1 * k)
        made.append(Frame(stamp=0.1 * k, odometry=odometry, scan=scan, truth=truth))
        truth = se2.compose(truth, step)
        odometry = se2.compose(odometry, 1.02 * step)
    return made


def ranges_from(pose, angles):
    """Distances to the walls of the room."""
    x, y, theta = pose
    cos, sin = np.cos(angles + theta), np.sin(angles + theta)
    cos, sin = (np.where(np.abs(part) < 1e-12, 1e-12, part) for part in (cos, sin))  # along a wall
    to_x = (np.where(cos > 0, HALF, -HALF) - x) / cos
    to_y = (np.where(sin > 0, HALF, -HALF) - y) / sin
    return np.minimum(to_x, to_y)


class Wheels:
    """The smallest system; subclasses break one thing each."""

    name, version = "wheels", "1"

    def start(self, lidars, seed):
        self.lidars, self.seed, self.seen = lidars, seed, []

    def process(self, frame):
        self.seen.append(frame)
        return frame.odometry

    def finish(self):
        return None, None
