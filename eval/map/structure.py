# SPDX-License-Identifier: MIT
"""Measure a map without a truth: crisp or blurred, plain or cluttered.

Occupied share, corners and enclosed areas after Filatov, Filatov, Krinkin, Chen, Molodan, "2D SLAM quality evaluation
methods", FRUCT 2017: of several maps of one place, a bad one has more of each (double walls add all three).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from slam.occupancy import OccupancyGrid

MIN_AREA = 0.25
"""Smallest enclosed area that is counted [m^2]."""


@dataclass(frozen=True)
class MapStructure:
    """Measures without truth; compare them only between maps of one place."""

    occupied_share: float
    """Occupied / known cells, 0 to 1. Trap: more furniture seen raises it as double walls do."""
    corners: int
    """Number of corners of walls, 0 and up. Traps: rough walls have corners as well; corners within about ten cells
    of each other count as one."""
    enclosed_areas: int
    """Number of areas of at least `MIN_AREA` enclosed by walls, 0 and up. Trap: closed rooms count, and one gap opens
    them."""
    entropy_bits: float
    """Mean of -p log2 p - (1 - p) log2 (1 - p) over the known cells, 0 to 1 bit. Trap: it
    does not see a bent map and can prefer the worse one; never read it alone."""
    known_area_m2: float
    """Area of the known cells [m^2]. Trap: a beam through a window adds to it."""


def map_structure(grid: OccupancyGrid) -> MapStructure | None:
    """Measure a map; returns None where it has no known cell."""
    known = grid.known
    if not known.any():
        return None
    p = np.clip(grid.probability[known].astype(np.float64), 1e-9, 1.0 - 1e-9)
    entropy = -(p * np.log2(p) + (1.0 - p) * np.log2(1.0 - p))
    return MapStructure(
        occupied_share=float(grid.occupied.sum() / known.sum()),
        corners=_corners(grid),
        enclosed_areas=_enclosed_areas(grid),
        entropy_bits=float(entropy.mean()),
        known_area_m2=float(known.sum() * grid.resolution**2),
    )


def _corners(grid: OccupancyGrid) -> int:
    """Count peaks of the corner measure det - 0.05 trace^2 (Harris and Stephens, 1988) of the smoothed walls."""
    padded = np.pad(grid.occupied, 1)  # a gradient needs at least two cells a side
    walls = ndimage.gaussian_filter(padded.astype(np.float32), 1.5)
    gy, gx = np.gradient(walls)
    xx, xy, yy = (ndimage.gaussian_filter(product, 2.0) for product in (gx * gx, gx * gy, gy * gy))
    response = xx * yy - xy * xy - 0.05 * (xx + yy) ** 2
    # A clean right angle of walls one cell thick responds with 3.7e-6, a T with 5.9e-6, straight walls stay below 0.
    peak = (response == ndimage.maximum_filter(response, size=9)) & (response > 1e-6)
    return int(ndimage.label(peak, np.ones((3, 3)))[1])


def _enclosed_areas(grid: OccupancyGrid) -> int:
    """Count connected areas of cells that are not occupied, without those that reach the map's edge."""
    open_cells = np.pad(~grid.occupied, 1, constant_values=True)
    labels, count = ndimage.label(open_cells)
    sizes = np.bincount(labels.ravel(), minlength=count + 1) * grid.resolution**2
    outside = labels[0, 0]
    return int(sum(sizes[label] >= MIN_AREA for label in range(1, count + 1) if label != outside))
