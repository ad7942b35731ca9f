# SPDX-License-Identifier: MIT
"""The free cells of a map, written plainly."""

import numpy as np

from slam.occupancy import OccupancyGrid


def free_cells(grid: OccupancyGrid):
    """Centres of the free cells, (n, 2) [m], seen from the grid's corner."""
    rows, columns = np.nonzero(grid.free)
    return np.column_stack([(columns + 0.5) * grid.resolution, (rows + 0.5) * grid.resolution])
