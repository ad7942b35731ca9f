# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Poses between those of a history, and the velocities between them."""

import numpy as np

from slam._jit import kernel

_SLACK = 1e-6  # times may lie this far outside of what is kept, by rounding [periods]


@kernel
def locate(times, known, period, first, kept):
    """Return where `times` (n,) [s] lie among the kept poses, as fractional indices (n,), and whether all are kept.

    known (n,): number of poses since time 0 that count, later times are moved back to the last of them; period [s];
    first: index since time 0 of the first of `kept` poses
    """
    positions, are_kept = np.empty(times.shape[0]), True
    for i in range(times.shape[0]):
        position = times[i] / period - first
        are_kept &= -_SLACK <= position <= kept - 1 + _SLACK
        positions[i] = max(min(position, known[i] - 1.0 - first), 0.0)
    return positions, are_kept


@kernel
def interpolate(poses, positions):
    """Return the poses (m, 3) at fractional indices `positions` (m,) into `poses` (n, 3), interpolated linearly."""
    found = np.empty((positions.shape[0], 3))
    last = poses.shape[0] - 1
    for i in range(positions.shape[0]):
        k = min(int(positions[i]), last)
        weight = positions[i] - k
        for axis in range(3):
            found[i, axis] = poses[k, axis]
            if weight != 0.0 and k < last:
                found[i, axis] += weight * (poses[k + 1, axis] - poses[k, axis])
    return found


@kernel
def mean_velocities(begins, ends, seconds):
    """Return the mean velocities (n, 3) in the frames of the poses `begins` (n, 3) that lead to `ends` (n, 3) within
    `seconds` (n,)."""
    velocities = np.empty_like(begins)
    for i in range(begins.shape[0]):
        cos, sin, dt = np.cos(begins[i, 2]), np.sin(begins[i, 2]), seconds[i]
        dx, dy = ends[i, 0] - begins[i, 0], ends[i, 1] - begins[i, 1]
        velocities[i, 0] = (cos * dx + sin * dy) / dt
        velocities[i, 1] = (-sin * dx + cos * dy) / dt
        velocities[i, 2] = (ends[i, 2] - begins[i, 2]) / dt
    return velocities
