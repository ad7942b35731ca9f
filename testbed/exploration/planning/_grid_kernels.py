# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Searches on grids of cells: shortest paths to all cells, and the cells visible from one."""

import heapq

import numpy as np

from slam._jit import kernel

_DIAGONAL = np.sqrt(2.0)


@kernel
def shortest_paths(step_cost, row, col):
    """Return the costs of the cheapest paths from cell (row, col) to all cells [cells], (rows, cols), and for each cell
    the one before it on its path as row * cols + col, (rows, cols); inf and -1 for cells that cannot be reached.

    step_cost (rows, cols): cost of a step per cell's width, inf = closed. Steps lead to the eight neighbours, but not
    diagonally between two closed cells. Source: Dijkstra (1959).
    """
    rows, cols = step_cost.shape
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
                if not (0 <= r2 < rows and 0 <= c2 < cols) or np.isinf(step_cost[r2, c2]):
                    continue
                if dr != 0 and dc != 0 and np.isinf(step_cost[r, c2]) and np.isinf(step_cost[r2, c]):
                    continue
                length = _DIAGONAL if dr != 0 and dc != 0 else 1.0
                total = cost + length * 0.5 * (min(step_cost[r, c], step_cost[r2, c2]) + step_cost[r2, c2])
                if total < costs[r2, c2]:
                    costs[r2, c2], before[r2, c2] = total, cell
                    heapq.heappush(heap, (total, r2 * cols + c2))
    return costs, before


@kernel
def visible_sum(values, opaque, row, col, reach, rays):
    """Return the sum of `values` (rows, cols) over all cells visible from cell (row, col).

    opaque (rows, cols): cells that end a ray and are counted;  reach: length of the rays [cells];  rays: their number,
    in evenly spaced directions
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
