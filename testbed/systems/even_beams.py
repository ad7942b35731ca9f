# SPDX-License-Identifier: MIT
"""Scans with evenly spaced beams, for systems that know a first angle and a step only."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam.scan import Scan


def evenly_spaced(scan: Scan) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the beams of a scan that evenly spaced ones take their readings from, and the angles [rad], (beams,) each.

    The angles increase from the scan's smallest to its largest; each takes the reading of the nearest beam.
    """
    order = np.argsort(scan.angles, kind="stable")
    angles = scan.angles[order]
    even = np.linspace(angles[0], angles[-1], len(angles))
    after = np.clip(np.searchsorted(angles, even), 1, len(angles) - 1)
    nearest = np.where(even - angles[after - 1] <= angles[after] - even, after - 1, after)
    return order[nearest], even
