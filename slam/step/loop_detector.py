# SPDX-License-Identifier: MIT
"""Detects when a robot sees an area again that it left long ago: the moment at which a loop closes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


class LoopDetector:
    """Detects loops by how far the robot has driven since the walls that it sees were last seen; it closes none."""

    LOOP = 15.0
    """Distance driven since walls were last seen that makes seeing them again a loop [m]."""
    SHARE = 0.25
    """Share of the hits on such walls with which a loop closes: a few beams through a door do not close one."""

    def __init__(self) -> None:
        self._travelled = [0.0]  # at each scan that was counted into the maps, which are numbered from 1
        self._last_return = -self.LOOP

    def begin(self) -> None:
        """Note that the first scan was counted into the maps."""
        self._travelled.append(0.0)

    def update(self, last_seen: NDArray[np.int64], distance: float) -> float:
        """Length of the loop that a scan closes [m]; 0 where it closes none.

        last_seen (hits,): number of the scan by which the map last changed about each end point, 0 = by none
        distance: driven since the scan before [m]. A loop is reported once: not again until the robot has driven `LOOP`
        metres without such a return.
        """
        now = self._travelled[-1] + distance
        self._travelled.append(now)
        ago = now - np.array(self._travelled)[last_seen]
        old = (last_seen > 0) & (ago >= self.LOOP)
        if len(last_seen) == 0 or np.mean(old) < self.SHARE:
            return 0.0
        new = now - self._last_return >= self.LOOP
        self._last_return = now
        return float(np.median(ago[old])) if new else 0.0

    def state(self) -> dict[str, Any]:
        """Everything remembered, as plain values."""
        return {"travelled": self._travelled, "last_return": self._last_return}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._travelled, self._last_return = list(state["travelled"]), state["last_return"]
