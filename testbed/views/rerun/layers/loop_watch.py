# SPDX-License-Identifier: MIT
"""What is said of a loop: one line when it begins to close, one when the particles have settled."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from eval.filter.closing_loop import CLOSING_S
from eval.wording import at_time
from slam.step.step_report import StepReport


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
    least: tuple[float, float] | None
    """Smallest spread since [m], and its time [s]."""
    died: int = 0
    """Particles that have died since."""
    most_died: tuple[int, float] = (0, 0.0)
    """The most that have died in one resampling, and its time [s]."""

    def note(self, time: float, died: int, spread: float | None) -> None:
        """Take in what an update at a time [s] did to the particles."""
        self.died += died
        if died > self.most_died[0]:
            self.most_died = died, time
        if spread is not None and (self.least is None or spread < self.least[0]):
            self.least = spread, time


class LoopLine(NamedTuple):
    """What is to be said of a loop."""

    level: Literal["INFO", "WARN"]
    text: str


@dataclass
class LoopWatch:
    """Follows each loop from its first scan until the particles have settled."""

    _times: list[float] = field(default_factory=list)  # of the updates [s]
    _closing: ClosingLoop | None = None

    @property
    def closing(self) -> bool:
        """Whether a loop was closing at the last update."""
        return self._closing is not None

    def update(self, time: float, step: StepReport, died: int, spread: float | None, lost: bool) -> list[LoopLine]:
        """Take in an update, and return what is to be said.

        time: of the update [s];  died: number of particles;  lost: whether the estimate is lost
        spread: of the particles [m]; None with a single one
        """
        self._times.append(time)
        lines = []
        if self._closing is not None and abs(time - self._closing.grew) >= CLOSING_S:
            lines += self.end(lost)
        if step.loop_closed:
            level: Literal["INFO", "WARN"] = "WARN" if lost else "INFO"
            lines.append(LoopLine(level, self._first_line(step, spread) + (", while lost" if lost else "")))
            if self._closing is None:
                self._closing = ClosingLoop(step.loop_length, time, time, spread, None)
            self._closing.length, self._closing.grew = max(self._closing.length, step.loop_length), time
        if self._closing is not None:
            self._closing.note(time, died, spread)
        return lines

    def _first_line(self, step: StepReport, spread: float | None) -> str:
        """What is said of a loop when it begins to close."""
        then = f"{self._times[-1 - step.loop_updates]:.0f} s, {step.loop_length:.0f} m ago"
        seen = f"back where it was at {then}" if step.loop_at_place else f"old walls in view again: last seen at {then}"
        spreading = "" if spread is None else f"; the particles spread {100 * spread:.1f} cm"
        return f"{seen}{spreading}"

    def end(self, lost: bool) -> list[LoopLine]:
        """What is to be said of the loop that was closing at the last update, if one was; lost: whether the estimate is
        lost."""
        loop, self._closing = self._closing, None
        if loop is None:
            return []
        if lost:
            return [LoopLine("WARN", f"the loop of {loop.length:.0f} m has not helped: the estimate is lost")]
        text = f"after the loop of {loop.length:.0f} m"
        if loop.spread is None or loop.least is None:
            return [LoopLine("INFO", f"{text}: a single particle cannot correct it")]
        most, at = loop.most_died
        deaths = f"{count_of(loop.died)} died"
        if most:
            deaths = f"{count_of(most)} died at {at_time(at)}"
            deaths += f" ({loop.died} in all)" if loop.died > most else ""
        least, least_at = loop.least
        spread = f"the spread went from {100 * loop.spread:.1f} to {100 * least:.1f} cm (at {at_time(least_at)})"
        return [LoopLine("INFO", f"{text}: {deaths}, {spread}")]


def count_of(particles: int) -> str:
    """A number of particles in words."""
    return f"{particles} particle{'' if particles == 1 else 's'}"
