# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Kernels that environments call on grid maps at every step."""

import numpy as np

from slam._jit import kernel


@kernel
def cut_square(probability, T_cells_robot, cells, cell, per_side):
    """Return P(occupied), 0.5 where unknown, and whether known (0 or 1), (2, cells, cells), of a square around it.

    probability (rows, cols), NaN = unknown;  T_cells_robot (3,): the robot in the map's cells [cells, cells, rad];
    cell: side of a cell of the square [cells of the map], which takes the highest of per_side² points in it
    """
    out = np.empty((2, cells, cells), np.float32)
    rows, cols = probability.shape
    x, y = T_cells_robot[0], T_cells_robot[1]
    cos, sin = np.cos(T_cells_robot[2]), np.sin(T_cells_robot[2])
    for i in range(cells):
        for j in range(cells):
            highest = np.float32(-1.0)
            for k in range(per_side * per_side):
                left = (i - 0.5 * cells + (k // per_side + 0.5) / per_side) * cell
                ahead = (j - 0.5 * cells + (k % per_side + 0.5) / per_side) * cell
                col, row = int(np.floor(x + cos * ahead - sin * left)), int(np.floor(y + sin * ahead + cos * left))
                if 0 <= row < rows and 0 <= col < cols and probability[row, col] > highest:  # NaN is not
                    highest = probability[row, col]
            known = highest >= 0.0
            out[0, i, j] = highest if known else np.float32(0.5)
            out[1, i, j] = 1.0 if known else 0.0
    return out


@kernel
def count_agreeing(shown, true, T_true_shown, scale):
    """Return the number of cells of `shown` (rows, cols) whose centre lies in a cell of `true` that is true as well.

    T_true_shown (3,): the shown map's corner in the cells of the true one [cells, cells, rad];  scale: side of a shown
    cell [true cells]
    """
    cos, sin = np.cos(T_true_shown[2]) * scale, np.sin(T_true_shown[2]) * scale
    rows, cols = true.shape
    count = 0
    for i in range(shown.shape[0]):
        for j in range(shown.shape[1]):
            if shown[i, j]:
                col = int(np.floor(T_true_shown[0] + cos * (j + 0.5) - sin * (i + 0.5)))
                row = int(np.floor(T_true_shown[1] + sin * (j + 0.5) + cos * (i + 0.5)))
                if 0 <= row < rows and 0 <= col < cols and true[row, col]:
                    count += 1
    return count
