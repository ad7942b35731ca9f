# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled fits of lines to end points in windows of cells, and the choice of surfels among the lines.

Moments are `w, wx, wy, wxx, wxy, wyy, wv` of end points with weights w and variances v as they were estimated, in
metres from the centre of their cell.
"""

from __future__ import annotations

import numpy as np

from slam._jit import inlined, kernel
from slam._planar_kernels import principal_axes
from slam.refinement._cell_index_kernels import cell_at

MIN_POINTS = 3
"""A line needs at least this many end points."""
MIN_SAME_SIDE_COSINE = 0.7
"""Surfels compete where the cosine of the angle between their normals is at least this."""


@kernel
def place_cloud(start, stop, poses, cloud, placed):
    """Move the end points of the scans [start, stop) into the map's frame; poses (scans, 3)."""
    ends, origins, first = cloud.ends, cloud.origins, cloud.first
    points, view_directions = placed.points, placed.view_directions
    for scan in range(start, stop):
        cos, sin = np.cos(poses[scan, 2]), np.sin(poses[scan, 2])
        for i in range(first[scan], first[scan + 1]):
            points[i, 0] = poses[scan, 0] + cos * ends[i, 0] - sin * ends[i, 1]
            points[i, 1] = poses[scan, 1] + sin * ends[i, 0] + cos * ends[i, 1]
            bx, by = origins[i, 0] - ends[i, 0], origins[i, 1] - ends[i, 1]
            length = max(np.sqrt(bx * bx + by * by), 1e-9)
            view_directions[i, 0] = (cos * bx - sin * by) / length
            view_directions[i, 1] = (sin * bx + cos * by) / length


@kernel
def add_moments(placed, ranges, noise, found, cells, cell_of, normals, moments, counts):
    """Moments (cells, 2, 7) and counts (cells, 2) of the end points, by the side of `normals` (cells, 2) from which
    they were seen; both are added to. noise: with which they count;  found: as it was estimated"""
    points, view_directions, coordinates = placed.points, placed.view_directions, cells.coordinates
    for i in range(points.shape[0]):
        cell = cell_of[i]
        side = 0 if normals[cell, 0] * view_directions[i, 0] + normals[cell, 1] * view_directions[i, 1] >= 0.0 else 1
        r2 = ranges[i] * ranges[i]
        w = 1.0 / (noise.floor + max(noise.along, noise.across) * r2)  # the wall has no normal yet
        x = points[i, 0] - cells.corner[0] - (coordinates[cell, 0] + 0.5) * cells.side
        y = points[i, 1] - cells.corner[1] - (coordinates[cell, 1] + 0.5) * cells.side
        m = moments[cell, side]
        m[0] += w
        m[1] += w * x
        m[2] += w * y
        m[3] += w * x * x
        m[4] += w * x * y
        m[5] += w * y * y
        m[6] += w * (found.floor + found.shared + max(found.along, found.across) * r2)
        counts[cell, side] += 1


@inlined
def add_shifted(total, m, dx, dy):
    """Add the moments m (7,) of a cell whose centre lies at (dx, dy) [m] to total (7,)."""
    w, x, y = m[0], m[1], m[2]
    total[0] += w
    total[1] += x + w * dx
    total[2] += y + w * dy
    total[3] += m[3] + (2.0 * x + w * dx) * dx
    total[4] += m[4] + x * dy + y * dx + w * dx * dy
    total[5] += m[5] + (2.0 * y + w * dy) * dy
    total[6] += m[6]


@inlined
def fit_line(m):
    """Mean x, y, unit normal nx, ny, smaller and larger variance of moments m (7,)."""
    mx, my = m[1] / m[0], m[2] / m[0]
    cxx, cxy, cyy = m[3] / m[0] - mx * mx, m[4] / m[0] - mx * my, m[5] / m[0] - my * my
    along, smaller, larger = principal_axes(cxx, cxy, cyy)
    return mx, my, -np.sin(along), np.cos(along), smaller, larger


@kernel
def fit_normals(start, stop, cells, moments, radius, normals):
    """Normals (cells, 2) of the lines through the end points within `radius` cells of each cell in [start, stop),
    whichever side they were seen from."""
    tiles, indices, coordinates = cells.tiles, cells.indices, cells.coordinates
    total = np.empty(7)
    for cell in range(start, stop):
        total[:] = 0.0
        for dy in range(-radius, radius + 1):
            for dx in range(-radius, radius + 1):
                if dx * dx + dy * dy <= radius * radius:
                    other = cell_at(tiles, indices, coordinates[cell, 0] + dx, coordinates[cell, 1] + dy)
                    if other >= 0:
                        add_shifted(total, moments[other, 0], dx * cells.side, dy * cells.side)
        _, _, normals[cell, 0], normals[cell, 1], _, _ = fit_line(total)


@kernel
def fit_lines(start, stop, cells, moments, counts, normals, radius, flatness, lines, support):
    """Lines through the end points within `radius` cells of each cell in [start, stop), by the side that they were
    seen from.

    moments (cells, 2, 7), counts (cells, 2) and normals (cells, 2): as `add_moments` made them. End points form a line
    where their variance across it, less what the noise makes, is at most `flatness` of that along it.
    support (cells, 2) out: number of end points of each line
    """
    tiles, indices, coordinates = cells.tiles, cells.indices, cells.coordinates
    total = np.empty(7)
    for cell in range(start, stop):
        x0 = cells.corner[0] + (coordinates[cell, 0] + 0.5) * cells.side
        y0 = cells.corner[1] + (coordinates[cell, 1] + 0.5) * cells.side
        for side in range(2):
            lines.weight[cell, side] = 0.0
            total[:] = 0.0
            count = 0
            for dy in range(-radius, radius + 1):
                for dx in range(-radius, radius + 1):
                    if dx * dx + dy * dy > radius * radius:
                        continue
                    other = cell_at(tiles, indices, coordinates[cell, 0] + dx, coordinates[cell, 1] + dy)
                    if other >= 0:
                        alike = normals[cell, 0] * normals[other, 0] + normals[cell, 1] * normals[other, 1] >= 0.0
                        same = side if alike else 1 - side
                        count += counts[other, same]
                        add_shifted(total, moments[other, same], dx * cells.side, dy * cells.side)
            if count < MIN_POINTS:
                continue
            mx, my, nx, ny, across, along = fit_line(total)
            if across - total[6] / total[0] > flatness * along:
                continue
            towards = nx * normals[cell, 0] + ny * normals[cell, 1]
            if (towards < 0.0) != (side == 1):
                nx, ny = -nx, -ny
            away = nx * mx + ny * my  # distance of the line from the cell's centre
            lines.weight[cell, side], support[cell, side] = total[0], count
            lines.point[cell, side, 0], lines.point[cell, side, 1] = x0 + away * nx, y0 + away * ny
            lines.normal[cell, side, 0], lines.normal[cell, side, 1] = nx, ny


@kernel
def is_free(cell, side, cells, lines, spacing, taken, reach):
    """Whether no line that is `taken` (cells, 2) lies within `spacing` [m], along it and across it, of that of a cell
    and side; looks at the cells up to `reach` away in x and in y."""
    tiles, indices, coordinates = cells.tiles, cells.indices, cells.coordinates
    x, y = lines.point[cell, side]
    nx, ny = lines.normal[cell, side]
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            other = cell_at(tiles, indices, coordinates[cell, 0] + dx, coordinates[cell, 1] + dy)
            if other < 0:
                continue
            for s in range(2):
                if taken[other, s]:
                    mx, my = lines.normal[other, s]
                    ex, ey = lines.point[other, s, 0] - x, lines.point[other, s, 1] - y
                    near = abs(mx * ex + my * ey) < spacing and abs(mx * ey - my * ex) < spacing
                    if near and nx * mx + ny * my > MIN_SAME_SIDE_COSINE:
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
    taken = np.zeros((cells.coordinates.shape[0], 2), np.bool_)
    count = 0
    for k in range(order.shape[0]):
        cell, side = order[k] >> 1, order[k] & 1
        if is_free(cell, side, cells, lines, spacing, taken, reach):
            taken[cell, side] = True
            chosen[count] = order[k]
            count += 1
    return count
