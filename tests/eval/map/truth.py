# SPDX-License-Identifier: MIT
"""The true map of the tests of maps, and copies of it."""

import numpy as np

from slam.occupancy import OccupancyGrid
from tests.eval.helpers import room

IDENTITY = np.zeros(3)
TRUTH = room()
EVERYWHERE = TRUTH.known
WALLS, CELLS = int(TRUTH.occupied.sum()), int(EVERYWHERE.sum())
ROW = 20 + 40  # a row through the middle of the room (margin of 20 cells, 80 rows of floor)


def like_truth(probability) -> OccupancyGrid:
    return OccupancyGrid(
        probability=np.asarray(probability, dtype=np.float32), resolution=TRUTH.resolution, origin=TRUTH.origin
    )
