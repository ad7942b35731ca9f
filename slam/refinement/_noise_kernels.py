# SPDX-License-Identifier: MIT
# mypy: ignore-errors
"""Compiled part of the estimate of the noise: means over the end points by which a scan sees a surfel."""

from __future__ import annotations

import numpy as np

from slam._jit import kernel


@kernel
def average_pairs(first, surfel, deviation, ranges, view_directions, normal, pairs):
    """Means over the end points of each pair of a scan and a surfel; returns how many pairs there are.

    first (scans + 1,);  surfel (n,): -1 = none;  deviation (n,), ranges (n,);  view_directions (n, 2)
    normal (surfels, 2)
    pairs (n, 4) out: mean deviation [m], number of end points, means of (range cosine)^2 and (range sine)^2 [m^2]
    """
    row_of, count = np.full(normal.shape[0], -1, np.int64), 0
    for scan in range(first.shape[0] - 1):
        begin = count
        for i in range(first[scan], first[scan + 1]):
            e = surfel[i]
            if e < 0:
                continue
            row = row_of[e]
            if row < begin:  # of an earlier scan, or none
                row_of[e] = row = count
                pairs[row] = 0.0
                count += 1
            cosine = normal[e, 0] * view_directions[i, 0] + normal[e, 1] * view_directions[i, 1]
            r2, c2 = ranges[i] * ranges[i], cosine * cosine
            pairs[row, 0] += deviation[i]
            pairs[row, 1] += 1.0
            pairs[row, 2] += r2 * c2
            pairs[row, 3] += r2 * (1.0 - c2)
        for row in range(begin, count):
            for k in (0, 2, 3):
                pairs[row, k] /= pairs[row, 1]
    return count
