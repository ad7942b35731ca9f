# SPDX-License-Identifier: MIT
"""Whether the truth of a recording can be that of the robot."""

from __future__ import annotations

import numpy as np

from testbed.frame_table import FrameTable
from testbed.inspect.finding import Finding

PIECE = 1.0
"""Ways are compared over pieces of so long [s]: those from frame to frame are mostly noise."""
MIN_WAY = 0.1
"""Pieces in which the robot drove less by its odometry [m] say nothing."""
MIN_PIECES = 5
MAX_RATIO = 2.0
"""Truth and odometry that differ by more than this factor are of another unit, or of another object."""


def inspect_truth(table: FrameTable) -> Finding:
    """How much of the drive the truth covers, and whether it goes as far as the odometry."""
    known = table.known(table.truth)
    if not known.any():
        return Finding("truth", "none")
    found = f"known at {np.mean(known):.0%} of the frames"
    ratio = _ratio(table, known)
    if ratio is not None and not 1.0 / MAX_RATIO < ratio < MAX_RATIO:
        found += f"; it goes {ratio:.3g} m for each m of the odometry"
        return Finding("truth", found, "doubtful", "scored as it is: is it of another object, or in millimetres?")
    return Finding("truth", found)


def _ratio(table: FrameTable, known: np.ndarray) -> float | None:
    """The way by the truth over that by the odometry; None where too little of both is known."""
    rows = np.flatnonzero(known)
    rows = rows[np.unique(np.floor(table.stamps[rows] / PIECE), return_index=True)[1]]
    ways = [np.hypot(*np.diff(poses[rows, :2], axis=0).T) for poses in (table.truth, table.odometry)]
    near = (np.diff(table.stamps[rows]) < 2.0 * PIECE) & (ways[1] > MIN_WAY)
    return float(ways[0][near].sum() / ways[1][near].sum()) if near.sum() >= MIN_PIECES else None
