# SPDX-License-Identifier: MIT
"""What is said of a loop: one line when it begins to close, one when the particles have settled."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field

from slam.step.step_report import StepReport

CLOSING_S = 15.0
"""The particles settle on one history within about this time [s]."""


@dataclass
class ClosingLoop:
    """A loop of which the first scan has come."""

    length: float
    """Driven since these walls were last seen, or since the robot was last at this place [m]."""
    began: float
    """Time of that scan; of the first one, if a longer loop has taken the place of a shorter one [s]."""
    grew: float
    """Time of the last scan that made it longer [s]."""
    spread: float | None
    """Spread of the particles at the first scan [m]; None with a single one."""
    died: int = 0
    """Particles that have died since."""


@dataclass
class LoopWatch:
    """Follows each loop from its first scan until the particles have settled."""

    _times: list[float] = field(default_factory=list)  # of the updates [s]
    _travelled: list[float] = field(default_factory=list)  # distance driven by then [m]
    _closing: ClosingLoop | None = None
    _spread: float | None = None  # at the last update [m]

    @property
    def closing(self) -> bool:
        """Whether a loop was closing at the last update."""
        return self._closing is not None

    def update(self, time: float, travelled: float, step: StepReport, died: int, spread: float | None) -> list[str]:
        """Take in an update, and return what is to be said.

        time: of the update [s];  travelled: distance driven [m];  died: number of particles
        spread: of the particles [m]; None with a single one
        """
        self._times.append(time)
        self._travelled.append(travelled)
        lines = []
        if self._closing is not None and abs(time - self._closing.grew) >= CLOSING_S:
            lines += self.end()
        self._spread = spread
        if step.loop_closed:
            lines.append(self._first_line(travelled, step))
            if self._closing is None:
                self._closing = ClosingLoop(step.loop_length, time, time, spread)
            self._closing.length, self._closing.grew = max(self._closing.length, step.loop_length), time
        if self._closing is not None:
            self._closing.died += died
        return lines

    def _first_line(self, travelled: float, step: StepReport) -> str:
        """What is said of a loop when it begins to close."""
        then = f"{self._time_of(travelled - step.loop_length):.0f} s, {step.loop_length:.0f} m ago"
        seen = f"back where it was at {then}" if step.loop_at_place else f"walls last seen at {then}"
        spread = "" if self._spread is None else f"; the particles spread {100 * self._spread:.1f} cm"
        return f"loop closes: {seen}{spread}"

    def end(self) -> list[str]:
        """What is to be said of the loop that was closing at the last update, if one was."""
        loop, self._closing = self._closing, None
        if loop is None:
            return []
        text = f"loop of {loop.length:.0f} m closed"
        if loop.spread is None or self._spread is None:
            return [text]
        return [
            f"{text}: {count_of(loop.died)} died since {loop.began:.0f} s, the spread went from "
            f"{100 * loop.spread:.1f} to {100 * self._spread:.1f} cm"
        ]

    def _time_of(self, travelled: float) -> float:
        """Time of the last update by which the robot had driven no further [s]."""
        return self._times[max(bisect_right(self._travelled, travelled) - 1, 0)]


def count_of(particles: int) -> str:
    """A number of particles in words."""
    return f"{particles} particle{'' if particles == 1 else 's'}"
