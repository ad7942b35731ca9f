# SPDX-License-Identifier: MIT
"""What is said of a loop: one line when it begins to close, one when the particles have settled."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np

from slam.step.step_report import StepReport

CLOSING_S = 10.0
"""The particles settle on one history within about this time [s]."""


@dataclass
class ClosingLoop:
    """A loop whose first scan on old walls has come."""

    length: float
    """Driven since these walls were last seen [m]."""
    began: float
    """Time of that scan [s]."""
    spread: float
    """Spread of the particles at that scan [m]."""
    died: int = 0
    """Particles that have died since."""


@dataclass
class LoopWatch:
    """Follows each loop from the first scan that sees old walls until the particles have settled."""

    _times: list[float] = field(default_factory=list)  # of the updates [s]
    _travelled: list[float] = field(default_factory=list)  # distance driven by then [m]
    _closing: ClosingLoop | None = None
    _spread: float = 0.0  # at the last update [m]

    def update(self, time: float, travelled: float, step: StepReport, died: int) -> list[str]:
        """Take in an update: its time [s], the distance driven [m], and how many particles died; what is to be said."""
        self._times.append(time)
        self._travelled.append(travelled)
        lines = []
        if self._closing is not None and (step.loop_closed or abs(time - self._closing.began) >= CLOSING_S):
            lines += self.end()
        self._spread = spread_of(step)
        if step.loop_closed:
            self._closing = ClosingLoop(step.loop_length, time, self._spread)
            lines.append(
                f"loop closes: walls last seen at {self._time_of(travelled - step.loop_length):.0f} s, "
                f"{step.loop_length:.0f} m of driving ago; the particles spread over {100 * self._spread:.1f} cm"
            )
        if self._closing is not None:
            self._closing.died += died
        return lines

    def end(self) -> list[str]:
        """What is to be said of the loop that was closing at the last update, if one was."""
        loop, self._closing = self._closing, None
        if loop is None:
            return []
        return [
            f"loop of {loop.length:.0f} m closed: {count_of(loop.died)} died, the spread went from "
            f"{100 * loop.spread:.1f} to {100 * self._spread:.1f} cm"
        ]

    def _time_of(self, travelled: float) -> float:
        """Time of the last update by which the robot had driven no further [s]."""
        return self._times[max(bisect_right(self._travelled, travelled) - 1, 0)]


def spread_of(step: StepReport) -> float:
    """Standard deviation of the position over the particles [m]."""
    return float(np.sqrt(max(step.covariance[0, 0] + step.covariance[1, 1], 0.0)))


def count_of(particles: int) -> str:
    """A number of particles in words."""
    return f"{particles} particle{'' if particles == 1 else 's'}"
