# SPDX-License-Identifier: MIT
"""The wide search: starting points of the matcher anywhere where the odometry can be wrong, where it seems to be.

The lattice covers the widest component of the motion prior; the steps of its headings follow the range of the beams,
so that no end point jumps over a wall (correlative scan matching: Olson, "Real-Time Correlative Scan Matching",
ICRA 2009).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.grid.particle_maps import ParticleMaps
from slam.matching._wide_search_kernels import score_headings
from slam.matching.likelihood import BeamModel
from slam.motion.odometry_model import MotionPrior

REACH = 2.5
"""Half the width of the lattice in standard deviations of the widest component of the prior."""
STEP_SHARE = 0.5
"""Steps of the lattice in radii of the field, within which walls pull."""
MAX_HEADINGS = 2000
"""Headings of a lattice at most."""
BEAMS = 60
"""The lattice is scored by every k-th hit, but by at least this many hits if the scan has them."""
MAX_STARTS = 8
"""Starting points at most: the best local minima on the lattice."""


class Lattice(NamedTuple):
    """Deviations from the predicted pose, seen from there."""

    turn: NDArray[np.float64]
    """Headings [rad], (headings,)."""
    along: NDArray[np.float64]
    """Displacements along the heading [m], (along,)."""
    across: NDArray[np.float64]
    """Displacements across the heading [m], (across,)."""
    prior: NDArray[np.float64]
    """Cost of the prior [nats] above the lowest, (headings, along, across)."""


def make_lattice(prior: MotionPrior, hits: NDArray[np.float64], step: float) -> Lattice:
    """Lattice over the third component of the prior; neighbouring points move no end point by more than about `step`.

    hits (K, 2) end points in the robot's frame [m];  step [m]
    """
    sigma = prior.precision[2] ** -0.5
    reach = max(float(np.quantile(np.hypot(hits[:, 0], hits[:, 1]), 0.75)), step)
    turn = _axis(min(REACH * sigma[2], np.pi), max(step / reach, 2.0 * np.pi / MAX_HEADINGS))
    along, across = _axis(REACH * sigma[0], step), _axis(REACH * sigma[1], step)
    z2 = (turn[:, None, None] / sigma[2]) ** 2 + (along[:, None] / sigma[0]) ** 2 + (across / sigma[1]) ** 2
    return Lattice(turn, along, across, 0.5 * z2)


def _axis(half: float, step: float) -> NDArray[np.float64]:
    n = int(np.ceil(half / step))
    return np.arange(-n, n + 1) * step


def wide_starts(
    maps: ParticleMaps,
    particle: int,
    guess: se2.Pose,
    hits: NDArray[np.float64],
    beams: BeamModel,
    prior: MotionPrior,
    bound: float,
) -> NDArray[np.float64]:
    """Starting points (n, 3) of the matcher seen from the predicted pose `guess` (3,), the likeliest first.

    They are the lowest local minima of the cost on a lattice, in the map of one particle, of at most `bound` [nats]
    above the lowest cost of the prior's third component.
    """
    step = STEP_SHARE * maps.config.field_radius
    every_kth = np.ascontiguousarray(hits[:: max(1, len(hits) // BEAMS)])
    lattice = make_lattice(prior, hits, step)
    grids = maps.grids
    distance2 = np.sum((grids.offset * maps.config.cell) ** 2, axis=1)
    distance2[0] = beams.far**2
    cost = distance2 / (1.0 + distance2 * beams.per_outlier2)
    cost *= 0.5 * beams.weight * beams.per_sigma2 * len(hits) / len(every_kth)
    out = np.empty(lattice.prior.shape)
    maps.threads.run(score_headings, len(lattice.turn), grids, particle, guess, lattice, every_kth, cost, bound, out)
    return _lowest_minima(lattice, out)


def _lowest_minima(lattice: Lattice, cost: NDArray[np.float64]) -> NDArray[np.float64]:
    """The lowest points of the lattice (n, 3) that are no neighbours of a lower one."""
    found, cost = [], cost.copy()
    for _ in range(MAX_STARTS):
        h, a, c = np.unravel_index(int(np.argmin(cost)), cost.shape)
        if not np.isfinite(cost[h, a, c]):
            break
        found.append((lattice.along[a], lattice.across[c], lattice.turn[h]))
        cost[max(h - 2, 0) : h + 3, max(a - 2, 0) : a + 3, max(c - 2, 0) : c + 3] = np.inf
    return np.array(found).reshape(-1, 3)
