# SPDX-License-Identifier: MIT
"""The roughness of surfaces, from readings of a log that met the same place from nearly the same view."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from testbed.simulation import SurfaceConfig
from testbed.twin.returns import ComparedScan
from testbed.twin.wall_pieces import WallPieces, WallReadings

Floats = NDArray[np.float64]

MAX_DEVIATION = 0.1
"""Readings farther off the wall than this met an edge or something else [m]."""
CUT = 0.02
"""Readings farther off than this count less for the place of a scan [m]."""
SAME_PLACE = 0.03
"""Readings in one cell of this side met the same place [m]."""
SAME_VIEW = (math.radians(2.0), 0.2)
"""Beams whose directions [rad] and lengths [m] differ by less have the same view."""
MIN_PAIRS = 1000
"""With fewer pairs nothing is said: surfaces are smooth."""


def estimate_surface(
    compared: Iterable[ComparedScan], segments: Floats, noise: tuple[float, float, float]
) -> SurfaceConfig:
    """Estimate how rough surfaces are, from scans and the walls of the world.

    segments (n, 4) [m]: pieces of walls; noise: standard deviation of short ranges [m], of long ones as a share, and
    step of the ranges [m]

    Each scan is first moved to where it fits the walls best: an error of its pose is nothing rough. Two readings of one
    place from one view share what is rough there, so that the mean of their product is its variance; what they do not
    share is noise and scatter. The fourth moment tells how few readings scatter how far.
    """
    one, other, ranges = _pairs(_readings(compared, WallPieces(segments[:, :2], segments[:, 2:])))
    if len(one) < MIN_PAIRS:
        return SurfaceConfig()
    rough = max(float(np.mean(one * other)), 0.0)
    floor, share, step = noise
    own = float(np.mean(np.maximum(floor, share * ranges) ** 2)) + step**2 / 12.0
    apart = (one - other) / math.sqrt(2.0)
    scatter, scatter_share = _mixture(float(np.mean(apart**2)), float(np.mean(apart**4)), own)
    return SurfaceConfig(
        roughness=round(math.sqrt(rough), 5), scatter=round(scatter, 5), scatter_share=round(scatter_share, 4)
    )


def _readings(compared: Iterable[ComparedScan], walls: WallPieces) -> Floats:
    """Return the readings that met a wall, (n, 6): how far off [m], place x, y [m], direction [rad], length [m],
    scan."""
    parts = [np.empty((0, 6))]
    for number, scan in enumerate(compared):
        met = walls.readings_of(scan, MAX_DEVIATION)
        rough = _off_best_fit(met, scan.origin)
        turned, numbers = np.mod(met.directions, 2.0 * math.pi), np.full(len(rough), float(number))
        columns = [rough, *met.places.T, turned, met.due, numbers]
        parts.append(np.column_stack(columns))
    readings = np.concatenate(parts)
    readings[:, 0] -= np.median(readings[:, 0]) if len(readings) else 0.0
    return readings


def _off_best_fit(met: WallReadings, origin: Floats) -> Floats:
    """Return by how much readings are off [m], (n,), where their scan is moved to fit the walls, to first order.

    origin (2,): position of the lidar [m]
    """
    ends = met.places - origin
    lever = ends[:, 0] * met.normals[:, 1] - ends[:, 1] * met.normals[:, 0]
    moves = np.column_stack([met.normals, lever]) / met.cosines[:, None]  # how a move (x, y, heading) changes them
    weights = np.sqrt(CUT / np.maximum(np.abs(met.off), CUT))
    move = np.linalg.lstsq(moves * weights[:, None], met.off * weights, rcond=1e-3)[0]
    rest: Floats = met.off - moves @ move
    return rest


def _pairs(readings: Floats) -> tuple[Floats, Floats, Floats]:
    """Return deviations [m] of both readings of pairs of one place and view, of readings (n, 6), and their lengths [m],
    (k,) each."""
    cells = np.floor(readings[:, 1:3] / SAME_PLACE)
    order = np.lexsort((readings[:, 3], cells[:, 1], cells[:, 0]))
    a, b = readings[order[:-1]], readings[order[1:]]
    same = (np.diff(cells[order], axis=0) == 0.0).all(axis=1) & (a[:, 5] != b[:, 5])
    same &= (np.abs(a[:, 3] - b[:, 3]) < SAME_VIEW[0]) & (np.abs(a[:, 4] - b[:, 4]) < SAME_VIEW[1])
    return a[same, 0], b[same, 0], a[same, 4]


def _mixture(second: float, fourth: float, own: float) -> tuple[float, float]:
    """Return size [m] and share of what scatters, from moments of half differences [m^2, m^4] and the noise's variance.

    Readings are N(0, own), a share p of them N(0, own + s^2): their variance is own + p s^2, their fourth cumulant
    3 p (1 - p) s^4, and that of a difference divided by sqrt(2) half of it.
    """
    variance = second - own
    if variance <= 0.0:
        return 0.0, 0.0
    cumulant = max(2.0 * (fourth - 3.0 * second**2), 0.0)
    share = 3.0 * variance**2 / (cumulant + 3.0 * variance**2)
    return math.sqrt(variance / share), share
