# SPDX-License-Identifier: MIT
# mypy: ignore-errors
# mypy: allow-untyped-defs, allow-untyped-calls
"""Kernel of rough surfaces: the sum of waves at the end of each beam. A product of matrices, which libraries compute
in an order that depends on the number of rows, would not give the same bits for one beam and for many."""

import numpy as np

from slam._jit import kernel


@kernel
def _cos_of_turns(turns):
    """Return the cosine of an angle in turns, to 1e-4: its series, since the library's cosine would take five times as
    long."""
    z = (turns - np.floor(turns + 0.5)) ** 2
    return 1.0 + z * (
        -19.7392088 + z * (64.9393940 + z * (-85.4568172 + z * (60.2446414 + z * (-26.4262568 + z * 7.9035364))))
    )


@kernel
def sum_waves(distances, origins, directions, waves, phases):
    """Return the sum of the cosines of all waves at the end of each beam, (beams,); any where it met nothing.

    distances (beams,) [m], origins (beams, 2) [m] and directions (beams,) [rad]: the beams; waves (n, 4): wave numbers
    of place [turns/m] and of the direction's unit vector [turns]; phases (n,) [turns]
    """
    n = distances.shape[0]
    sums, cos, sin, x, y = np.zeros(n), np.cos(directions), np.sin(directions), np.zeros(n), np.zeros(n)
    for i in range(n):
        if np.isfinite(distances[i]):
            x[i], y[i] = origins[i, 0] + distances[i] * cos[i], origins[i, 1] + distances[i] * sin[i]
    for k in range(phases.shape[0]):
        along_x, along_y, of_cos, of_sin = waves[k, 0], waves[k, 1], waves[k, 2], waves[k, 3]
        for i in range(n):
            sums[i] += _cos_of_turns(along_x * x[i] + along_y * y[i] + of_cos * cos[i] + of_sin * sin[i] + phases[k])
    return sums
