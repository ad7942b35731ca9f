# SPDX-License-Identifier: MIT
"""The wide search: starting points of the matcher wherever the robot can be, if the odometry says nothing of the step.

The lattice covers the widest component of the motion prior; the steps of its headings follow the range of the beams,
so that no end point jumps over a wall (correlative scan matching: Olson, "Real-Time Correlative Scan Matching",
ICRA 2009).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.grid._cell_kernels import NO_WALL
from slam.grid.particle_maps import ParticleMaps
from slam.matching._wide_search_kernels import score_headings
from slam.matching.likelihood import BeamModel, ScanAndPrior
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
    turn_cost: NDArray[np.float64]
    """Cost of the prior for each heading [nats] above the lowest, (headings,)."""
    along_cost: NDArray[np.float64]
    """The same along the heading, (along,)."""
    across_cost: NDArray[np.float64]
    """The same across the heading, (across,)."""


def make_lattice(prior: MotionPrior, hits: NDArray[np.float64], step: float) -> Lattice:
    """Lattice over the third component of the prior; neighbouring points move no end point by more than about `step`.

    hits (K, 2) end points in the robot's frame [m];  step [m]
    """
    sigma = prior.precision[2] ** -0.5
    third_quartile = 3 * len(hits) // 4
    reach = max(float(np.partition(np.hypot(hits[:, 0], hits[:, 1]), third_quartile)[third_quartile]), step)
    turn = _axis(min(REACH * sigma[2], np.pi), max(step / reach, 2.0 * np.pi / MAX_HEADINGS))
    along, across = _axis(REACH * sigma[0], step), _axis(REACH * sigma[1], step)
    costs = [0.5 * (x / s) ** 2 for x, s in zip((turn, along, across), (sigma[2], sigma[0], sigma[1]), strict=True)]
    return Lattice(turn, along, across, *costs)


def _axis(half: float, step: float) -> NDArray[np.float64]:
    """Multiples of `step` from -half to half, which it reaches or exceeds."""
    n = int(np.ceil(half / step))
    axis: NDArray[np.float64] = np.arange(-n, n + 1, dtype=np.float64) * step
    return axis


def wide_starts(
    maps: ParticleMaps, particle: int, predicted: se2.Pose, scan_and_prior: ScanAndPrior, *, max_cost: float
) -> NDArray[np.float64]:
    """Starting points (n, 3) of the matcher seen from the predicted pose (3,), the likeliest first.

    They are the lowest local minima of the cost on a lattice, in the map of one particle, that lie below `max_cost`
    [nats] and can lead to a lower one.
    """
    hits, beams, prior = scan_and_prior
    step = STEP_SHARE * maps.config.field_radius
    every_kth = np.ascontiguousarray(hits[:: max(1, len(hits) // BEAMS)])
    lattice = make_lattice(prior, hits, step)
    cost = _cost_of_words(maps, beams, slack=0.5 * step) * (len(hits) / len(every_kth))
    bound = max_cost + float(prior.log_scale[2])  # the lattice counts from the lowest cost of a jump
    out = np.empty((len(lattice.turn), len(lattice.along), len(lattice.across)))
    arguments = (maps.grids, particle, predicted, lattice, every_kth, cost, bound, out)
    maps.threads.run(score_headings, len(lattice.turn), *arguments)
    return _lowest_minima(lattice, out)


def _cost_of_words(maps: ParticleMaps, beams: BeamModel, *, slack: float) -> NDArray[np.float64]:
    """Cost [nats] of a beam by the field word of the cell that its end point lies in, (words,).

    Walls count as nearer by `slack` [m]: a pose between the points of the lattice may bring an end point that much
    closer, so that a point's cost is hardly above the lowest near it, and the bound cuts no optimum off.
    """
    distance = np.hypot(*maps.grids.offset.T) * maps.config.cell
    nearest2 = np.maximum(distance - slack, 0.0) ** 2
    nearest2[NO_WALL] = beams.far**2
    cost: NDArray[np.float64] = nearest2 / (1.0 + nearest2 * beams.per_outlier2)
    return 0.5 * beams.weight * beams.per_sigma2 * cost


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
