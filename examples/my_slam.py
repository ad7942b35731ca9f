# SPDX-License-Identifier: MIT
"""A SLAM system in thirty lines of code: each scan is put where most of its points meet walls that were seen before.

testbed systems check examples/my_slam.py:MySlam
testbed run office --system examples/my_slam.py:MySlam,odometry,gmapping
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from slam import se2
from slam.occupancy import OccupancyGrid


@dataclass(frozen=True)
class Settings:
    """What `--system-set MySlam.FIELD=VALUE` changes."""

    cell: float = 0.05
    """Side of a cell of the map [m]."""
    reach: float = 0.05
    """A scan may be moved by so much from where the odometry puts it [m]."""
    turn: float = 0.02
    """A scan may be turned by so much [rad]."""
    step: float = 0.1
    """Scans in between are left out until the robot has moved or turned by so much [m, rad]."""


class MySlam:
    """Scan matching by trial on a grid of walls, 60 m wide, around the first pose."""

    name, version = "my-slam", "1.0"

    def __init__(self, settings: Settings | None = None):
        self.settings = settings or Settings()

    def start(self, lidars, seed):
        """Begin with an empty map at the origin."""
        self.walls = np.zeros((1200, 1200), np.float32)
        self.pose, self.odometry, self.used = np.zeros(3), None, None
        r, t = self.settings.reach, self.settings.turn
        moves = np.array(list(product((0, -r, r, -r / 2, r / 2), (0, -r, r, -r / 2, r / 2), (0, -t, t, -t / 2, t / 2))))
        self.moves = moves[np.argsort(np.abs(moves).sum(axis=1), kind="stable")]  # of equal ones the smallest counts

    def process(self, frame):
        """Move by the odometry, then to the best place nearby, and draw the scan."""
        if self.odometry is not None:
            self.pose = se2.compose(self.pose, se2.between(self.odometry, frame.odometry))
        self.odometry = frame.odometry
        moved = None if self.used is None else np.abs(se2.between(self.used, frame.odometry)).max()
        still = moved is not None and moved < self.settings.step
        if still or frame.scan is None or not frame.scan.hit.any():
            return self.pose
        self.used = frame.odometry
        ranges, angles = frame.scan.ranges[frame.scan.hit], frame.scan.angles[frame.scan.hit]
        points = np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles)])
        points = se2.transform_points(frame.scan.mount, points)  # from the lidar's frame to the robot's
        poses = se2.compose(self.pose, self.moves)
        self.pose = poses[np.argmax([self.walls[self.cells(pose, points)].sum() for pose in poses])]
        rows, cols = self.cells(self.pose, points)
        for row, col in product((-1, 0, 1), (-1, 0, 1)):  # next to a wall is half as good as on it
            np.maximum.at(self.walls, (rows + row, cols + col), 1.0 if row == col == 0 else 0.5)
        return self.pose

    def cells(self, pose, points):
        """Rows and columns of points (k, 2) seen from a pose (3,), (k,) each."""
        cells = np.floor(se2.transform_points(pose, points) / self.settings.cell).astype(int) + 600
        return tuple(np.clip(cells, 1, 1198).T[::-1])

    def finish(self):
        """The poses that were reported are final; only walls are known."""
        corner = -600 * self.settings.cell
        walls = np.where(self.walls == 1.0, 0.9, np.nan).astype(np.float32)
        return None, OccupancyGrid(probability=walls, resolution=self.settings.cell, origin=(corner, corner, 0.0))
