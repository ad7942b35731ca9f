# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled correlative matching of two local maps by branch and bound.

Hess, Kohler, Rapp, Andor, "Real-Time Loop Closure in 2D LIDAR SLAM", ICRA 2016, section V-B: at level l a node stands
for 2^l x 2^l displacements, and the sum of the largest values that each point can meet there bounds their scores.
"""

from __future__ import annotations

import numpy as np

from slam._array_kernels import copy_matrix, copy_values
from slam._jit import inlined, kernel

MAX_SCORE = 2
"""Largest score of a point, on a wall."""


@kernel
def pool_maxima(values, levels):
    """levels (L, rows, columns) out: level l holds the largest of the 2^l x 2^l values from each cell on.

    values (rows, columns); beyond the border all values are 0
    """
    rows, columns = values.shape
    copy_matrix(values, levels[0])
    for level in range(1, levels.shape[0]):
        half = 1 << (level - 1)
        below = levels[level - 1]
        for y in range(rows):
            for x in range(columns):
                right = below[y, x + half] if x + half < columns else 0
                above = below[y + half, x] if y + half < rows else 0
                both = below[y + half, x + half] if x + half < columns and y + half < rows else 0
                levels[level, y, x] = max(below[y, x], right, above, both)


@inlined
def bound_of(level, size, points, dx, dy, lowest):
    """Largest score that the points (n, 2) [cells] can have at the size x size displacements of a node.

    Where a node begins outside and reaches inside, the first row and column bound it. Stops where the rest cannot
    lift the sum above `lowest`; what it returns then is no more than that.
    """
    total, left = 0, points.shape[0]
    rows, columns = level.shape
    for k in range(points.shape[0]):
        x, y = points[k, 0] + dx, points[k, 1] + dy
        if x < columns and y < rows and x > -size and y > -size:
            value = level[max(y, 0), max(x, 0)]
            total += max(value, 0) if x < 0 or y < 0 else value
        left -= 1
        if total + left * MAX_SCORE <= lowest:
            return lowest
    return total


@kernel
def bound_coarsest(levels, points, reach, lowest, nodes, bounds):
    """Nodes of the coarsest level whose bound is above `lowest`, for all headings; returns how many there are.

    nodes (n, 4) out: displacement [cells], number of the heading, level;  bounds (n,) out
    """
    top = levels.shape[0] - 1
    size, count = 1 << top, 0
    for h in range(points.shape[0]):
        for y in range(-reach, reach + 1, size):
            for x in range(-reach, reach + 1, size):
                bound = bound_of(levels[top], size, points[h], x, y, lowest)
                if bound > lowest:
                    nodes[count, 0], nodes[count, 1], nodes[count, 2], nodes[count, 3] = x, y, h, top
                    bounds[count] = bound
                    count += 1
    return count


@kernel
def push_children(levels, points, reach, lowest, node, stack, bounds, depth):
    """Put the four parts of a node (4,) whose bound is above `lowest` on the stack, the best on top; returns its new
    depth. A node may reach beyond the window, its parts may not begin there."""
    x, y, h, level = node
    half, bottom = 1 << (level - 1), depth
    for part in range(4):
        px, py = x + (part & 1) * half, y + (part >> 1) * half
        if px > reach or py > reach:
            continue
        bound = bound_of(levels[level - 1], half, points[h], px, py, lowest)
        if bound > lowest:
            k = depth
            while k > bottom and bounds[k - 1] > bound:
                bounds[k] = bounds[k - 1]
                copy_values(stack[k - 1], stack[k])
                k -= 1
            bounds[k] = bound
            stack[k, 0], stack[k, 1], stack[k, 2], stack[k, 3] = px, py, h, level - 1
            depth += 1
    return depth


@kernel
def search(levels, points, reach, lowest, avoid, best):
    """Displacement and heading of the largest score above `lowest`.

    levels: see `pool_maxima`, values at most `MAX_SCORE`;  points (headings, n, 2) [cells] at each heading and no
    displacement;  reach: displacements go from -reach to +reach in x and y [cells]
    avoid (5,): displacement and number of the heading in the middle of a box of half widths avoid[3] [cells] and
    avoid[4] [headings] in which no leaf counts;  best (3,) out: displacement and number of the heading
    Returns the score; `lowest` where there is none above it.
    """
    per_axis = (2 * reach) // (1 << (levels.shape[0] - 1)) + 1
    nodes = np.empty((points.shape[0] * per_axis * per_axis, 4), np.int64)
    coarse = np.empty(nodes.shape[0], np.int64)
    count = bound_coarsest(levels, points, reach, lowest, nodes, coarse)
    stack, bounds = np.empty((4 * levels.shape[0], 4), np.int64), np.empty(4 * levels.shape[0], np.int64)
    node = np.empty(4, np.int64)
    for r in np.argsort(-coarse[:count]):
        copy_values(nodes[r], stack[0])
        bounds[0], depth = coarse[r], 1
        while depth > 0:
            depth -= 1
            if bounds[depth] <= lowest:
                continue
            copy_values(stack[depth], node)
            if node[3] > 0:
                depth = push_children(levels, points, reach, lowest, node, stack, bounds, depth)
            elif (
                abs(node[0] - avoid[0]) > avoid[3]
                or abs(node[1] - avoid[1]) > avoid[3]
                or abs(node[2] - avoid[2]) > avoid[4]
            ):
                lowest = bounds[depth]
                copy_values(node, best)
    return lowest
