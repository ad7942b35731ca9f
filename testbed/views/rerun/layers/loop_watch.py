# SPDX-License-Identifier: MIT
"""What is said of a loop: one line when it begins to close, and once the particles have settled one at the time by
which report and terminal name it (`eval.filter.closing_loop.ClosingLoop.to_watch`)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from eval.filter.closing_loop import CLOSING_S, MIN_JUMP_M
from eval.wording import at_time
from slam.step.step_report import StepReport
from testbed.views.rerun.layers.prediction import Time


@dataclass
class ClosingLoop:
    """A loop of which the first scan has come."""

    length: float
    """Driven since these walls were last seen, or since the robot was last at this place [m]."""
    began: Time
    """Time of that scan; of the first one, if a longer loop has taken the place of a shorter one."""
    full: Time
    """Time of the scan with which it has its length."""
    grew: float
    """Time of the last scan that closed it [s]."""
    spread: float | None
    """Spread of the particles at the first scan [m]; None with a single one."""
    least: tuple[float, float] | None = None
    """Smallest spread since [m], and its time [s]."""
    died: int = 0
    """Particles that have died since."""
    most_died: tuple[int, Time] | None = None
    """The most that have died in one resampling, and its time."""
    jump: tuple[float, Time] | None = None
    """How far the reported pose moved at most because another particle became the best [m], and when."""

    @property
    def named(self) -> Time:
        """The time by which it is named."""
        if self.most_died is not None:
            return self.most_died[1]
        return self.full if self.jump is None else self.jump[1]

    def note(self, time: Time, died: int, moved: float, spread: float | None) -> None:
        """Take in what an update at a time did to the particles, and how far the reported pose moved as another one
        became the best [m]."""
        self.died += died
        if died > (0 if self.most_died is None else self.most_died[0]):
            self.most_died = died, time
        if moved > (MIN_JUMP_M if self.jump is None else self.jump[0]):
            self.jump = moved, time
        if spread is not None and (self.least is None or spread < self.least[0]):
            self.least = spread, time[0]


class LoopLine(NamedTuple):
    """What is to be said of a loop."""

    level: Literal["INFO", "WARN"]
    text: str
    at: Time | None = None
    """When it happened; None = now."""


@dataclass
class LoopWatch:
    """Follows each loop from its first scan until the particles have settled."""

    _times: list[float] = field(default_factory=list)  # of the updates [s]
    _closing: ClosingLoop | None = None

    @property
    def closing(self) -> bool:
        """Whether a loop was closing at the last update."""
        return self._closing is not None

    def update(
        self, time: Time, step: StepReport, died: int, moved: float, spread: float | None, lost: bool
    ) -> list[LoopLine]:
        """Take in an update, and return what is to be said.

        time: of the update;  died: number of particles;  lost: whether the estimate is lost
        moved: distance of the reported pose from that of the particle that was the best before [m]
        spread: of the particles [m]; None with a single one
        """
        self._times.append(time[0])
        lines = []
        if self._closing is not None and abs(time[0] - self._closing.grew) >= CLOSING_S:
            lines += self.end(lost)
        if step.loop_closed:
            level: Literal["INFO", "WARN"] = "WARN" if lost else "INFO"
            lines.append(LoopLine(level, self._first_line(step, spread) + (", while lost" if lost else "")))
            if self._closing is None:
                self._closing = ClosingLoop(step.loop_length, time, time, time[0], spread)
            self._closing.grew = time[0]
            if step.loop_length > self._closing.length:
                self._closing.length, self._closing.full = step.loop_length, time
        if self._closing is not None:
            self._closing.note(time, died, moved, spread)
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
        text = f"loop of {loop.length:.0f} m"
        if loop.spread is None or loop.least is None:
            return [LoopLine("INFO", f"{text}: a single particle cannot correct it", loop.named)]
        most = 0 if loop.most_died is None else loop.most_died[0]
        deaths = f"{count_of(most)} died" + (f" ({loop.died} in all)" if loop.died > most else "")
        least, least_at = loop.least
        before, after = (f"{100 * spread:.1f} cm" for spread in (loop.spread, least))
        spreads = f"the spread went from {before} at {at_time(loop.began[0])} to {after} at {at_time(least_at)}"
        return [LoopLine("INFO", f"{text}: {deaths}; {spreads}", loop.named)]


def count_of(particles: int) -> str:
    """A number of particles in words."""
    return f"{particles} particle{'' if particles == 1 else 's'}"
