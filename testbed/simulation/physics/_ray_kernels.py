# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Exact ray casting among line segments that are binned into square cells.

A ray marches through the cells that it crosses (Amanatides and Woo, A Fast Voxel Traversal Algorithm for Ray Tracing,
1987), is intersected with the segments of each, and stops when the nearest hit lies before the next cell.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import inlined, kernel

_SLACK = 1e-9  # cells and segments are this much larger [m]: no ray slips through where two of them meet


class SegmentGrid(NamedTuple):
    """Segments in the order of the cells that they touch.

    A segment that touches several cells is stored several times, so that a ray reads memory in order.
    """

    segments: NDArray[np.float64]
    """`(x0, y0, x1, y1)` [m], (touches, 4)."""
    first: NDArray[np.int64]
    """Cell k = row * cols + col is touched by `segments[first[k] : first[k + 1]]`, (cells + 1,)."""
    shape: tuple[int, int]
    """Rows and columns."""
    origin: tuple[float, float]
    """Outer corner of cell (0, 0) [m]."""
    cell: float
    """Side of a cell [m]."""


@kernel
def _touches(segment, x_low, y_low, side):
    """Return whether the segment (4,) touches the square of that lower corner and side.

    The separating axes are x, y and the normal of the segment.
    """
    x0, y0, x1, y1 = segment[0], segment[1], segment[2], segment[3]
    x_high, y_high = x_low + side, y_low + side
    if max(x0, x1) < x_low or min(x0, x1) > x_high or max(y0, y1) < y_low or min(y0, y1) > y_high:
        return False
    nx, ny = y0 - y1, x1 - x0
    offset = nx * (0.5 * (x_low + x_high) - x0) + ny * (0.5 * (y_low + y_high) - y0)
    return abs(offset) <= 0.5 * side * (abs(nx) + abs(ny))


@kernel
def bin_segments(segments, shape, origin, cell):
    """Return `first` of a `SegmentGrid` and the indices of the segments that touch each cell (touches,); all must lie
    on the grid."""
    rows, cols = shape
    count = np.zeros(rows * cols + 1, np.int64)
    for fill in range(2):
        if fill:
            first = np.zeros_like(count)
            for k in range(rows * cols):
                first[k + 1] = first[k] + count[k]
            items = np.empty(first[-1], np.int64)
            used = first.copy()
        for s in range(segments.shape[0]):
            x0, y0, x1, y1 = segments[s]
            col_low = max(int(np.floor((min(x0, x1) - _SLACK - origin[0]) / cell)), 0)
            col_high = min(int(np.floor((max(x0, x1) + _SLACK - origin[0]) / cell)), cols - 1)
            row_low = max(int(np.floor((min(y0, y1) - _SLACK - origin[1]) / cell)), 0)
            row_high = min(int(np.floor((max(y0, y1) + _SLACK - origin[1]) / cell)), rows - 1)
            for row in range(row_low, row_high + 1):
                for col in range(col_low, col_high + 1):
                    x_low, y_low = origin[0] + col * cell - _SLACK, origin[1] + row * cell - _SLACK
                    if not _touches(segments[s], x_low, y_low, cell + 2.0 * _SLACK):
                        continue
                    k = row * cols + col
                    if fill:
                        items[used[k]] = s
                        used[k] += 1
                    else:
                        count[k] += 1
    return first, items


@inlined
def distance_along(segment, x, y, cos, sin):
    """Return the distance [m] from (x, y) along (cos, sin) to the segment (4,); inf if the ray misses it or runs along
    it."""
    ax, ay = segment[0] - x, segment[1] - y
    bx, by = segment[2] - x, segment[3] - y
    left, right = ay * cos - ax * sin, by * cos - bx * sin  # of the ray's line lie the ends: this far
    if left * right > 0.0 and min(abs(left), abs(right)) > _SLACK:
        return np.inf
    ex, ey = bx - ax, by - ay
    denominator = cos * ey - sin * ex
    if denominator == 0.0:
        return np.inf
    along = (ax * ey - ay * ex) / denominator
    return along if along >= 0.0 else np.inf


@inlined
def _cast_one(grid, x, y, cos, sin, reach):
    """Return the distance [m] to the first segment and its index in `grid.segments`; inf and -1 if there is none within
    `reach` or the origin lies off the grid."""
    rows, cols = grid.shape
    gx, gy = (x - grid.origin[0]) / grid.cell, (y - grid.origin[1]) / grid.cell
    col, row = int(np.floor(gx)), int(np.floor(gy))
    col_step, row_step = (1 if cos > 0.0 else -1), (1 if sin > 0.0 else -1)
    # distances at which the ray crosses into the next column and row, and between crossings
    to_col = ((col + (cos > 0.0)) - gx) * grid.cell / cos if cos != 0.0 else np.inf
    to_row = ((row + (sin > 0.0)) - gy) * grid.cell / sin if sin != 0.0 else np.inf
    col_pitch = grid.cell / abs(cos) if cos != 0.0 else np.inf
    row_pitch = grid.cell / abs(sin) if sin != 0.0 else np.inf

    best, best_segment, entered = np.inf, -1, 0.0
    while 0 <= row < rows and 0 <= col < cols and entered <= min(best, reach):
        k = row * cols + col
        for i in range(grid.first[k], grid.first[k + 1]):
            distance = distance_along(grid.segments[i], x, y, cos, sin)
            if distance < best:
                best, best_segment = distance, i
        if to_col < to_row:
            entered, to_col, col = to_col, to_col + col_pitch, col + col_step
        else:
            entered, to_row, row = to_row, to_row + row_pitch, row + row_step
    if best > reach:
        return np.inf, -1
    return best, best_segment


@kernel
def cast_rays(grid, origins, directions, reach):
    """Return distances [m] (rays,), inf where nothing lies within `reach` [m], and cosines of the angles of incidence
    (rays,).

    The rays go from `origins` (rays, 2) [m] along `directions` (rays,) [rad].
    """
    n = directions.shape[0]
    distances, cos_incidence = np.empty(n), np.zeros(n)
    for i in range(n):
        cos, sin = np.cos(directions[i]), np.sin(directions[i])
        distances[i], s = _cast_one(grid, origins[i, 0], origins[i, 1], cos, sin, reach)
        if s >= 0:
            ex = grid.segments[s, 2] - grid.segments[s, 0]
            ey = grid.segments[s, 3] - grid.segments[s, 1]
            cos_incidence[i] = abs(cos * ey - sin * ex) / np.sqrt(ex * ex + ey * ey)
    return distances, cos_incidence
