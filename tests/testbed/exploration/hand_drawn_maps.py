# SPDX-License-Identifier: MIT
"""Estimated maps drawn by hand, and beliefs about them."""

import numpy as np

from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from testbed.exploration import Belief

CELL = 0.05


def grid_of(picture, metre=4):
    """A map from text, first line = highest y: # wall, . free, ? unknown; a character is `metre` cells wide."""
    value = {"#": 0.97, ".": 0.12, "?": np.nan}
    rows = [[value[letter] for letter in line] for line in picture.split()][::-1]
    cells = np.repeat(np.repeat(np.array(rows, dtype=np.float32), metre, axis=0), metre, axis=1)
    return OccupancyGrid(probability=cells, resolution=CELL, origin=(0.0, 0.0, 0.0))


def scan_of(ranges=(np.inf,) * 360):
    n = len(ranges)
    angles = np.linspace(-np.pi, np.pi, n, endpoint=False)
    return Scan(ranges=np.array(ranges, dtype=float), angles=angles, range_max=12.0)


def belief(grid, pose, stamp=0.0, scans=None):
    return Belief(stamp=stamp, pose=np.array(pose, dtype=float), scans=scans or (scan_of(),), map=lambda: grid)
