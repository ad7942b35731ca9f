# SPDX-License-Identifier: MIT
"""Pictures of grid maps as PNG: the estimate, the truth, and where they differ. North (y) is up."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.image import imsave
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from eval.map.grids import cell_centres, resample
from slam.occupancy import OccupancyGrid
from slam.se2 import transform_points

MAX_SIDE = 1400
"""Pictures are thinned out to about this many pixels a side."""
RIGHT, MISSING, INVENTED, SEEN, UNSEEN = "#1b1f24", "#e8590c", "#c2255c", "#ffffff", "#d3d9e0"
"""Colours of the difference: walls right within a cell, missing, invented; ground that is known, and not."""
DIFFERENCE_KEY = ((RIGHT, "right within a cell"), (MISSING, "missing"), (INVENTED, "invented"), (UNSEEN, "never seen"))
Image = NDArray[np.uint8]
Extent = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class Picture:
    """An image and the place it shows, x and y in the map's frame turned by `-origin.theta`."""

    pixels: Image
    """(rows, cols, 3), first row on top."""
    extent: Extent
    """x of the left, x of the right, y of the lower, y of the upper edge [m]."""

    @property
    def data_uri(self) -> str:
        """The image as a `data:` address for HTML."""
        return "data:image/png;base64," + base64.b64encode(_png(self.pixels)).decode()


def frame_around(grid: OccupancyGrid, T_frame_grid: ArrayLike, paths: list[ArrayLike], margin: float) -> OccupancyGrid:
    """Empty cells, not turned, around the known part of a map seen from another frame, and the paths (n, 2) there."""
    corners = transform_points(T_frame_grid, cell_centres(grid, _outline(grid.known)))
    return frame_over([corners, *paths], grid.resolution, margin)


def frame_over(paths: Sequence[ArrayLike], cell: float, margin: float) -> OccupancyGrid:
    """Empty cells, not turned, of at least this side [m] around paths (n, 2) [m], with so much room about them [m]."""
    points = np.concatenate([np.asarray(path, dtype=np.float64).reshape(-1, 2) for path in paths])
    low = np.floor((points.min(axis=0) - margin) / cell) * cell
    high = points.max(axis=0) + margin
    resolution = cell * max(1.0, float(np.max(high - low)) / cell / MAX_SIDE)
    cols, rows = np.maximum(1, np.ceil((high - low) / resolution).astype(int))
    return OccupancyGrid(
        probability=np.full((rows, cols), np.nan, dtype=np.float32),
        resolution=resolution,
        origin=(float(low[0]), float(low[1]), 0.0),
    )


def draw_map(grid: OccupancyGrid, frame: OccupancyGrid, T_frame_grid: ArrayLike) -> Picture:
    """A map on the cells of `frame`: white free, black occupied, grey-blue unknown.

    P(occupied) is raised to the power 1.6: the usual 0.1 of free floor then differs clearly from unknown cells.
    """
    drawn = resample(grid, frame, T_frame_grid)
    shade = 1.0 - np.nan_to_num(drawn.probability)[:, :, None] ** 1.6
    pixels = shade * _rgb(SEEN) + (1.0 - shade) * _rgb(RIGHT)
    pixels[~drawn.known] = _rgb(UNSEEN)
    return Picture(np.flipud(pixels).astype(np.uint8), _extent(frame))


def draw_difference(
    grid: OccupancyGrid, truth: OccupancyGrid, frame: OccupancyGrid, T_frame_grid: ArrayLike
) -> Picture:
    """The walls of a map against those of the truth, in the truth's frame; right = within one cell."""
    drawn, true = resample(grid, frame, T_frame_grid), resample(truth, frame, np.zeros(3))
    near_true = ndimage.maximum_filter(true.occupied, size=3)
    near_drawn = ndimage.maximum_filter(drawn.occupied, size=3)
    pixels = np.empty((*frame.probability.shape, 3))
    pixels[:] = _rgb(UNSEEN)
    pixels[drawn.known] = _rgb(SEEN)
    # Walls that the map never came near are not missing but unexplored.
    explored = ndimage.maximum_filter(drawn.known, size=3)
    pixels[true.occupied & ~near_drawn & explored] = _rgb(MISSING)
    pixels[drawn.occupied & ~near_true] = _rgb(INVENTED)
    pixels[drawn.occupied & near_true] = _rgb(RIGHT)
    return Picture(np.flipud(pixels).astype(np.uint8), _extent(frame))


def _outline(known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The corners of the box around the known cells, of the whole map where there are none.

    The outermost 0.1 % of them on each side do not count: one beam through a window would shrink the picture.
    """
    rows, cols = (_span(known.sum(axis=axis)) for axis in (1, 0))
    mask = np.zeros_like(known)
    mask[np.ix_(rows, cols)] = True
    return mask


def _span(counts: NDArray[np.intp]) -> tuple[int, int]:
    """First and last index that hold all but the outermost 0.1 % of the counts on each side."""
    total = np.cumsum(counts)
    if total[-1] == 0:
        return 0, len(counts) - 1
    first, last = np.searchsorted(total, [0.001 * total[-1], 0.999 * total[-1]], side="right")
    return int(first), min(int(last), len(counts) - 1)


def _extent(frame: OccupancyGrid) -> Extent:
    rows, cols = frame.probability.shape
    x, y, _ = frame.origin
    return x, x + cols * frame.resolution, y, y + rows * frame.resolution


def _rgb(colour: str) -> NDArray[np.float64]:
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], dtype=np.float64)


def _png(pixels: Image) -> bytes:
    buffer = io.BytesIO()
    imsave(buffer, pixels, format="png")
    return buffer.getvalue()
