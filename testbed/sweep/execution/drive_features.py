# SPDX-License-Identifier: MIT
"""Features of a drive that need no world: of its path, its odometry and its scans; so logs have them too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slam.scan import Scan
from slam.se2 import Pose, between
from testbed.frame import Frame

KNOWN_WITHIN = 2.0
"""Floor is known to the robot once its path has passed it at this distance [m]."""
STEP = 0.5
"""Spacing of the points at which a path is looked at [m]."""
_PIECE = 1.0
"""Length of the pieces over which the odometry is compared, and spacing of the scans that are looked at [m]."""
_CHORD = (0.2, 0.5)
"""Two hits at this distance lie on one wall, and noise turns the line through them by few degrees only [m]."""
_LAGS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
"""Numbers of beams between two such hits that are tried."""
_MIN_OBSERVABILITY = 0.1
"""Below this a scan hardly determines one direction; the bound of `worlds.difficulty`."""


def drive_features(frames: Sequence[Frame], path: Pose) -> dict[str, float]:
    """Features of a drive, ready for JSON.

    path: poses of the robot at the frames that have a scan, (scans, 3): the truth, or an estimate for logs without it.
    `odometry_deg_per_m`: root mean square of the odometry's heading error over a metre; `scan_determined_share`: share
    of the way on which a scan by itself determines the position; `longest_unknown_m`: see `longest_unknown`.
    """
    at_scans = [frame for frame in frames if frame.scan is not None]
    odometry = np.array([frame.odometry for frame in at_scans])
    rows = _every(path[:, :2], _PIECE)
    seen = [observability(at_scans[k].scan) for k in rows]
    return {
        "longest_unknown_m": longest_unknown(path[_every(path[:, :2], STEP), :2]),
        "odometry_deg_per_m": round(_heading_error(odometry[rows], path[rows]), 4),
        "scan_determined_share": round(float(np.mean(np.array(seen) >= _MIN_OBSERVABILITY)), 4),
        "scan_observability": round(float(np.mean(seen)), 4),
    }


def longest_unknown(points: NDArray[np.float64]) -> float:
    """Longest way through floor that was not passed before [m]: what drift builds up over.

    points (n, 2): positions `STEP` apart along the path. A point is known if an earlier one, apart from those of the
    last `2 * KNOWN_WITHIN` metres, is within `KNOWN_WITHIN`.
    """
    lag = round(2.0 * KNOWN_WITHIN / STEP)
    longest = stretch = 0
    for k in range(len(points)):
        earlier = points[: max(k - lag, 0)]
        away = np.hypot(*(earlier - points[k]).T)
        stretch = 0 if (away < KNOWN_WITHIN).any() else stretch + 1
        longest = max(longest, stretch)
    return round(longest * STEP, 1)


def observability(scan: Scan) -> float:
    """How well a scan determines the position of the lidar in its worst direction, from 0 to 1.

    Twice the smaller eigenvalue of the mean of n nᵀ over all beams, where n is the normal of the wall that the beam and
    a later one hit, and zero where there is no such pair. 1 = walls in all directions, 0 = a bare corridor. The two
    hits are far enough apart for the noise of the ranges not to turn the normal.
    """
    order = np.argsort(scan.angles)
    ranges = np.where(scan.hit, scan.ranges, np.nan)[order]
    hits = np.stack([ranges * np.cos(scan.angles[order]), ranges * np.sin(scan.angles[order])], axis=-1)
    chord = np.full(hits.shape, np.nan)
    for lag in _LAGS:
        later = hits[lag:] - hits[:-lag]
        length = np.hypot(later[:, 0], later[:, 1])
        fits = np.isnan(chord[: len(later), 0]) & (length >= _CHORD[0]) & (length <= _CHORD[1])
        chord[: len(later)][fits] = later[fits] / length[fits, None]
    walls = chord[np.isfinite(chord[:, 0])]
    return float(2.0 * np.linalg.eigvalsh(walls.T @ walls / max(len(hits), 1))[0])  # turned normals: equal eigenvalues


def _every(positions: NDArray[np.float64], spacing: float) -> NDArray[np.intp]:
    """Rows of positions (n, 2) that are about `spacing` [m] apart along the path, from the first on."""
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(positions, axis=0).T))])
    rows: NDArray[np.intp] = np.unique(np.searchsorted(driven, np.arange(0.0, driven[-1] + 1e-9, spacing)))
    return rows[rows < len(positions)]


def _heading_error(odometry: Pose, path: Pose) -> float:
    """Root mean square of the odometry's heading error over the pieces between neighbouring poses (n, 3) [deg]."""
    if len(path) < 2:
        return 0.0
    error = between(between(path[:-1], path[1:]), between(odometry[:-1], odometry[1:]))[:, 2]
    return float(np.degrees(np.sqrt(np.mean(error**2))))
