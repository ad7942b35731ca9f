# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Searches on grids of cells: cheapest ways to everywhere, and what can be seen from a cell."""

import heapq

import numpy as np

from slam._jit import kernel

_DIAGONAL = np.sqrt(2.0)


@kernel
def cheapest_ways(dearness, row, col):
    """Costs of the cheapest way from cell (row, col) to each cell [cells], (rows, cols), and before which cell each one
    comes on it, as row * cols + col; inf and -1 where no way leads.

    dearness (rows, cols): cost of a step per cell's width, inf = closed. Ways lead to the eight neighbours, not between
    two closed cells. Dijkstra (1959).
    """
    rows, cols = dearness.shape
    costs, before = np.full((rows, cols), np.inf), np.full((rows, cols), -1)
    costs[row, col] = 0.0
    heap = [(0.0, row * cols + col)]
    while heap:
        cost, cell = heapq.heappop(heap)
        r, c = cell // cols, cell % cols
        if cost > costs[r, c]:
            continue
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                r2, c2 = r + dr, c + dc
                if not (0 <= r2 < rows and 0 <= c2 < cols) or np.isinf(dearness[r2, c2]):
                    continue
                if dr != 0 and dc != 0 and np.isinf(dearness[r, c2]) and np.isinf(dearness[r2, c]):
                    continue
                length = _DIAGONAL if dr != 0 and dc != 0 else 1.0
                total = cost + length * 0.5 * (min(dearness[r, c], dearness[r2, c2]) + dearness[r2, c2])
                if total < costs[r2, c2]:
                    costs[r2, c2], before[r2, c2] = total, cell
                    heapq.heappush(heap, (total, r2 * cols + c2))
    return costs, before


@kernel
def visible_sum(values, opaque, row, col, reach, rays):
    """Sum of `values` (rows, cols) over all cells within sight of cell (row, col).

    opaque (rows, cols): cells that end a ray, and count;  reach: of the rays [cells];  rays: how many, evenly all round
    """
    rows, cols = values.shape
    seen = np.zeros((rows, cols), np.bool_)
    total = 0.0
    for k in range(rays):
        angle = 2.0 * np.pi * k / rays
        dr, dc = np.sin(angle), np.cos(angle)
        for step in range(int(reach) + 1):
            r, c = int(np.floor(row + 0.5 + step * dr)), int(np.floor(col + 0.5 + step * dc))
            if not (0 <= r < rows and 0 <= c < cols):
                break
            if not seen[r, c]:
                seen[r, c] = True
                total += values[r, c]
            if opaque[r, c]:
                break
    return total
