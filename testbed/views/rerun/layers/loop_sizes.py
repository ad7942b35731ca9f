# SPDX-License-Identifier: MIT
"""How large a loop is that the filter has closed, and what became of the particles."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from slam.se2 import Pose
from slam.step.step_report import StepReport

MIN_LOOP_M = 5.0
"""What the robot saw less than this along its path ago is no loop [m]."""
CLOSING_S = 10.0
"""The particles settle on one history within about this time [s]."""


@dataclass
class LoopSizes:
    """Remembers when the robot was where, and the particles of the last seconds."""

    _updates: list[tuple[float, float]] = field(default_factory=list)  # time [s], distance driven [m]
    _recent: deque[tuple[float, float, int]] = field(default_factory=deque)  # time, spread of the particles [m], died

    def add(self, time: float, travelled: float, step: StepReport, died: int) -> None:
        """Take in an update: its time [s], the distance driven [m], and how many particles died."""
        self._updates.append((time, travelled))
        self._recent.append((time, spread_of(step), died))
        while abs(time - self._recent[0][0]) > CLOSING_S:
            self._recent.popleft()

    def sentence(self, path: Pose) -> str:
        """What has just been closed, and what became of the particles. path (updates, 3): the best particle's."""
        updates = np.array(self._updates[-len(path) :]).reshape(-1, 2)
        since, spreads = updates[-1, 1] - updates[:, 1], [spread for _, spread, _ in self._recent]
        old = np.flatnonzero(since >= MIN_LOOP_M)
        place = "the robot is back at a place that it left long ago"
        if len(old) and len(old) <= len(path):
            nearest = old[np.argmin(np.hypot(*(path[old, :2] - path[-1, :2]).T))]
            place = f"back where the robot was at {updates[nearest, 0]:.0f} s, after {since[nearest]:.0f} m"
        died = sum(dead for _, _, dead in self._recent)
        return (
            f"loop closed: {place}; in the last {CLOSING_S:.0f} s {count_of(died)} died, and the spread of the "
            f"particles went from {100 * max(spreads):.1f} to {100 * spreads[-1]:.1f} cm"
        )


def spread_of(step: StepReport) -> float:
    """Standard deviation of the position over the particles [m]."""
    return float(np.sqrt(max(step.covariance[0, 0] + step.covariance[1, 1], 0.0)))


def count_of(particles: int) -> str:
    """A number of particles in words."""
    return f"{particles} particle{'' if particles == 1 else 's'}"
