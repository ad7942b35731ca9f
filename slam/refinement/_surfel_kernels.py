# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled parts of the surfels: end points sorted into cells, lines through windows of cells, one surfel a place.

Cells are numbered as they are met; tiles of them give the number of the cell at any column and row.
Moments are `w, wx, wy, wxx, wxy, wyy` of end points with weights w, in metres from the centre of their cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam._jit import inlined, kernel
from slam.grid._tile_kernels import MASK, SHIFT, SIDE


class Cloud(NamedTuple):
    """End points of all scans, those of scan i from first[i] to first[i + 1]."""

    ends: NDArray[np.float64]
    """End points in the robot's frame [m], (n, 2)."""
    origins: NDArray[np.float64]
    """Where their beams start, in the robot's frame [m], (n, 2)."""
    ranges: NDArray[np.float64]
    """Lengths of the beams [m], (n,)."""
    first: NDArray[np.int64]
    """(scans + 1,)."""
    each: float
    """How many hits each end point stands for."""


class Placed(NamedTuple):
    """The cloud in the map's frame."""

    points: NDArray[np.float64]
    """End points [m], (n, 2)."""
    views: NDArray[np.float64]
    """Unit vectors from the end points to where they were seen from, (n, 2)."""


class Noise(NamedTuple):
    """Spread of end points about a wall."""

    floor2: float
    """Variance that is there at any distance [m^2]."""
    share2: float
    """Variance along the beam as a share of the squared range."""


class Cells(NamedTuple):
    """The cells in which end points lie."""

    tiles: NDArray[np.int32]
    """Number of the tile at (row, column) of tiles, (rows, columns); -1 = none."""
    numbers: NDArray[np.int32]
    """Number of each cell of the tiles, (tiles, SIDE * SIDE); -1 = no end point there."""
    places: NDArray[np.int32]
    """Column and row of each cell, (cells, 2)."""
    corner: NDArray[np.float64]
    """Position of the corner of cell (0, 0) [m], (2,)."""
    side: float
    """Of a cell [m]."""


class Lines(NamedTuple):
    """Lines through the end points about each cell, those seen from its one side (0) and from its other (1)."""

    weight: NDArray[np.float64]
    """Sum of the weights, (cells, 2); 0 where the end points form no line."""
    place: NDArray[np.float64]
    """The point of the line that is nearest to the cell's centre [m], (cells, 2, 2)."""
    normal: NDArray[np.float64]
    """Unit normal towards where the end points were seen from, (cells, 2, 2)."""


LEAST_POINTS = 3
"""Of a line."""
SAME_SIDE = 0.7
"""Least cosine of the angle between the normals of surfels that compete for a place."""


@kernel
def place_cloud(start, stop, poses, cloud, placed):
    """Move the end points of the scans [start, stop) into the map's frame; poses (scans, 3)."""
    ends, origins, first = cloud.ends, cloud.origins, cloud.first
    points, views = placed.points, placed.views
    for scan in range(start, stop):
        cos, sin = np.cos(poses[scan, 2]), np.sin(poses[scan, 2])
        for i in range(first[scan], first[scan + 1]):
            points[i, 0] = poses[scan, 0] + cos * ends[i, 0] - sin * ends[i, 1]
            points[i, 1] = poses[scan, 1] + sin * ends[i, 0] + cos * ends[i, 1]
            bx, by = origins[i, 0] - ends[i, 0], origins[i, 1] - ends[i, 1]
            length = max(np.sqrt(bx * bx + by * by), 1e-9)
            views[i, 0] = (cos * bx - sin * by) / length
            views[i, 1] = (sin * bx + cos * by) / length


@kernel
def mark_tiles(points, corner, side, tiles):
    """Number the tiles in which points (n, 2) lie, in their order; tiles (rows, columns) out. Returns how many."""
    tiles[:] = -1
    count = 0
    for i in range(points.shape[0]):
        cx, cy = int((points[i, 0] - corner[0]) / side), int((points[i, 1] - corner[1]) / side)
        if tiles[cy >> SHIFT, cx >> SHIFT] < 0:
            tiles[cy >> SHIFT, cx >> SHIFT] = count
            count += 1
    return count


@kernel
def mark_cells(points, corner, side, tiles, numbers, cell_of):
    """Number the cells in which points (n, 2) lie, in their order; numbers (tiles, SIDE * SIDE) and the cell of each
    point cell_of (n,) out. Returns how many."""
    numbers[:] = -1
    count = 0
    for i in range(points.shape[0]):
        cx, cy = int((points[i, 0] - corner[0]) / side), int((points[i, 1] - corner[1]) / side)
        tile, k = tiles[cy >> SHIFT, cx >> SHIFT], ((cy & MASK) << SHIFT) | (cx & MASK)
        if numbers[tile, k] < 0:
            numbers[tile, k] = count
            count += 1
        cell_of[i] = numbers[tile, k]
    return count


@kernel
def list_places(tiles, numbers, places):
    """Column and row of all cells, places (cells, 2) out."""
    for ty in range(tiles.shape[0]):
        for tx in range(tiles.shape[1]):
            if tiles[ty, tx] >= 0:
                for k in range(SIDE * SIDE):
                    cell = numbers[tiles[ty, tx], k]
                    if cell >= 0:
                        places[cell, 0] = (tx << SHIFT) + (k & MASK)
                        places[cell, 1] = (ty << SHIFT) + (k >> SHIFT)


@inlined
def cell_at(tiles, numbers, cx, cy):
    """Number of the cell at column cx and row cy, which may lie outside; -1 where no end point lies."""
    inside = 0 <= cx < (tiles.shape[1] << SHIFT) and 0 <= cy < (tiles.shape[0] << SHIFT)
    tile = tiles[cy >> SHIFT, cx >> SHIFT] if inside else -1
    return numbers[tile, ((cy & MASK) << SHIFT) | (cx & MASK)] if tile >= 0 else -1


@kernel
def add_moments(placed, ranges, noise, cells, cell_of, normals, moments, counts):
    """Moments (cells, 2, 6) and counts (cells, 2) of the end points, by the side of `normals` (cells, 2) from which
    they were seen; both are added to."""
    points, views, places = placed.points, placed.views, cells.places
    for i in range(points.shape[0]):
        cell = cell_of[i]
        side = 0 if normals[cell, 0] * views[i, 0] + normals[cell, 1] * views[i, 1] >= 0.0 else 1
        w = 1.0 / (noise.floor2 + noise.share2 * ranges[i] * ranges[i])
        x = points[i, 0] - cells.corner[0] - (places[cell, 0] + 0.5) * cells.side
        y = points[i, 1] - cells.corner[1] - (places[cell, 1] + 0.5) * cells.side
        m = moments[cell, side]
        m[0] += w
        m[1] += w * x
        m[2] += w * y
        m[3] += w * x * x
        m[4] += w * x * y
        m[5] += w * y * y
        counts[cell, side] += 1


@inlined
def shifted(total, m, dx, dy):
    """Add the moments m (6,) of a cell whose centre lies at (dx, dy) [m] to total (6,)."""
    w, x, y = m[0], m[1], m[2]
    total[0] += w
    total[1] += x + w * dx
    total[2] += y + w * dy
    total[3] += m[3] + (2.0 * x + w * dx) * dx
    total[4] += m[4] + x * dy + y * dx + w * dx * dy
    total[5] += m[5] + (2.0 * y + w * dy) * dy


@inlined
def principal(m):
    """Mean x, y, unit normal nx, ny, smaller and larger variance of moments m (6,)."""
    mx, my = m[1] / m[0], m[2] / m[0]
    cxx, cxy, cyy = m[3] / m[0] - mx * mx, m[4] / m[0] - mx * my, m[5] / m[0] - my * my
    mid, half = 0.5 * (cxx + cyy), np.sqrt(0.25 * (cxx - cyy) ** 2 + cxy * cxy)
    along = 0.5 * np.arctan2(2.0 * cxy, cxx - cyy)
    return mx, my, -np.sin(along), np.cos(along), mid - half, mid + half


@kernel
def fit_normals(start, stop, cells, moments, radius, normals):
    """Normals (cells, 2) of the lines through the end points within `radius` cells of each cell in [start, stop),
    whichever side they were seen from."""
    tiles, numbers, places = cells.tiles, cells.numbers, cells.places
    total = np.empty(6)
    for cell in range(start, stop):
        total[:] = 0.0
        for dy in range(-radius, radius + 1):
            for dx in range(-radius, radius + 1):
                if dx * dx + dy * dy <= radius * radius:
                    other = cell_at(tiles, numbers, places[cell, 0] + dx, places[cell, 1] + dy)
                    if other >= 0:
                        shifted(total, moments[other, 0], dx * cells.side, dy * cells.side)
        _, _, normals[cell, 0], normals[cell, 1], _, _ = principal(total)


@kernel
def fit_lines(start, stop, cells, moments, counts, normals, radius, flatness, lines):
    """Lines through the end points within `radius` cells of each cell in [start, stop), by the side that they were
    seen from.

    moments (cells, 2, 6), counts (cells, 2) and normals (cells, 2): as `add_moments` made them. End points form a line
    where their variance across it, less what the noise makes, is at most `flatness` of that along it.
    """
    tiles, numbers, places = cells.tiles, cells.numbers, cells.places
    total = np.empty(6)
    for cell in range(start, stop):
        x0 = cells.corner[0] + (places[cell, 0] + 0.5) * cells.side
        y0 = cells.corner[1] + (places[cell, 1] + 0.5) * cells.side
        for side in range(2):
            lines.weight[cell, side] = 0.0
            total[:] = 0.0
            count = 0
            for dy in range(-radius, radius + 1):
                for dx in range(-radius, radius + 1):
                    if dx * dx + dy * dy > radius * radius:
                        continue
                    other = cell_at(tiles, numbers, places[cell, 0] + dx, places[cell, 1] + dy)
                    if other >= 0:
                        alike = normals[cell, 0] * normals[other, 0] + normals[cell, 1] * normals[other, 1] >= 0.0
                        same = side if alike else 1 - side
                        count += counts[other, same]
                        shifted(total, moments[other, same], dx * cells.side, dy * cells.side)
            if count < LEAST_POINTS:
                continue
            mx, my, nx, ny, across, along = principal(total)
            if across - count / total[0] > flatness * along:
                continue
            towards = nx * normals[cell, 0] + ny * normals[cell, 1]
            if (towards < 0.0) != (side == 1):
                nx, ny = -nx, -ny
            away = nx * mx + ny * my  # distance of the line from the cell's centre
            lines.weight[cell, side] = total[0]
            lines.place[cell, side, 0], lines.place[cell, side, 1] = x0 + away * nx, y0 + away * ny
            lines.normal[cell, side, 0], lines.normal[cell, side, 1] = nx, ny


@kernel
def is_free(cell, side, cells, lines, spacing, taken, reach):
    """Whether no line that is `taken` (cells, 2) lies within `spacing` [m], along it and across it, of that of a cell
    and side; looks at the cells up to `reach` away in x and in y."""
    tiles, numbers, places = cells.tiles, cells.numbers, cells.places
    x, y = lines.place[cell, side]
    nx, ny = lines.normal[cell, side]
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            other = cell_at(tiles, numbers, places[cell, 0] + dx, places[cell, 1] + dy)
            if other < 0:
                continue
            for s in range(2):
                if taken[other, s]:
                    mx, my = lines.normal[other, s]
                    ex, ey = lines.place[other, s, 0] - x, lines.place[other, s, 1] - y
                    near = abs(mx * ex + my * ey) < spacing and abs(mx * ey - my * ex) < spacing
                    if near and nx * mx + ny * my > SAME_SIDE:
                        return False
    return True


@kernel
def choose(order, cells, lines, spacing, radius, chosen):
    """Greedily choose lines, no two of the same side within `spacing` [m] along and across the wall.

    order (m,): lines as 2 * cell + side, the best first;  radius [cells]: of the windows that they were fitted in
    chosen (m,) out: the choice, of which the number is returned
    """
    # two lines may both pass their cells at a distance, but within the window
    reach = int(np.ceil(spacing * np.sqrt(2.0) / cells.side)) + 2 * radius + 2
    taken = np.zeros((cells.places.shape[0], 2), np.bool_)
    count = 0
    for k in range(order.shape[0]):
        cell, side = order[k] >> 1, order[k] & 1
        if is_free(cell, side, cells, lines, spacing, taken, reach):
            taken[cell, side] = True
            chosen[count] = order[k]
            count += 1
    return count


@kernel
def cells_in_reach(x, y, cells, reach, out):
    """Cells within `reach` [m] of that of the point (x, y), out (m,) with room for all; returns their number."""
    tiles, numbers = cells.tiles, cells.numbers
    radius = int(np.ceil(reach / cells.side))
    cx = int(np.floor((x - cells.corner[0]) / cells.side))
    cy = int(np.floor((y - cells.corner[1]) / cells.side))
    count = 0
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            if dx * dx + dy * dy <= radius * radius:
                cell = cell_at(tiles, numbers, cx + dx, cy + dy)
                if cell >= 0:
                    out[count] = cell
                    count += 1
    return count


@kernel
def list_candidates(place, cells, reach):
    """Surfels at place (surfels, 2) within `reach` [m] of each cell.

    Returns first (cells + 1,) and items: those of cell i are items[first[i] : first[i + 1]].
    """
    radius = int(np.ceil(reach / cells.side))
    near = np.empty((2 * radius + 1) ** 2, np.int64)
    first = np.zeros(cells.places.shape[0] + 1, np.int64)
    for surfel in range(place.shape[0]):
        for k in range(cells_in_reach(place[surfel, 0], place[surfel, 1], cells, reach, near)):
            first[near[k] + 1] += 1
    first[:] = np.cumsum(first)
    free, items = first[:-1].copy(), np.empty(first[-1], np.int32)
    for surfel in range(place.shape[0]):
        for k in range(cells_in_reach(place[surfel, 0], place[surfel, 1], cells, reach, near)):
            items[free[near[k]]] = surfel
            free[near[k]] += 1
    return first, items
