# SPDX-License-Identifier: MIT
"""What the particles did while the largest loop of a run closed, from its table of steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eval.filter.step_table import Columns, column, updates
from eval.wording import at_time, length

MIN_FALL_M = 0.01
"""A loop has decided between the particles' histories where their spread falls by this much in it [m]."""
MIN_JUMP_M = 0.03
"""A smaller motion of the reported pose to another best particle is not named [m]."""
CLOSING_S = 15.0
"""The particles settle on one history within about this time after the last scan that closes a loop [s]."""


@dataclass(frozen=True)
class ClosingLoop:
    """A loop from the first scan that closes it until the particles have settled. Stamps are in [s]."""

    metres: float
    """Its length: path of the estimate since the walls, or the place, were seen before [m]."""
    began: float
    """Stamp of the first scan that closes it."""
    stamp: float
    """Stamp of the scan with which it has its full length."""
    end: float
    """Stamp of the last scan that belongs to it."""
    particles: int
    """Number of particles when it began."""
    died: int | None
    """Particles that died in it; None where that is unknown."""
    resamplings: int
    """In how many resamplings they died."""
    most_died: float | None
    """Stamp of the first resampling in which most of them died; None where none did."""
    most: int
    """How many died at that one."""
    jump: tuple[float, float] | None
    """How far the reported pose moved at most because another particle became the best [m], and when; None where it did
    not, or where that is unknown."""
    spread: float | None
    """Spread of the particles when it began [m]; None where that is unknown."""
    least_spread: tuple[float, float] | None
    """Their smallest spread in it [m], and its stamp."""
    errors: tuple[float, float] | None
    """Error of the pose while driving before the loop, and when it had settled [m]; None without truth."""
    jump_errors: tuple[float, float] | None = None
    """The same at the update before the jump, and at it [m]; None without a jump, or without truth."""
    longer: tuple[ClosingLoop, ...] = ()
    """Longer loops, none of which has decided between the particles' histories, in the order of time."""

    @property
    def to_watch(self) -> float:
        """Stamp by which it is named everywhere: the resampling in which most particles died, else where another one
        became the best, else the scan with which it has its full length."""
        if self.most_died is not None:
            return self.most_died
        return self.stamp if self.jump is None else self.jump[1]

    @property
    def settled(self) -> float:
        """Stamp from which its outcome can be seen: where the particles' spread is smallest, but not before
        `to_watch`."""
        return self.to_watch if self.least_spread is None else max(self.to_watch, self.least_spread[1])

    @property
    def decided(self) -> bool:
        """Whether it has decided between the particles' histories; where their spread is unknown, whether some died."""
        if self.spread is None or self.least_spread is None:
            return bool(self.died)
        return self.spread - self.least_spread[0] >= MIN_FALL_M


def largest_closing_loop(steps: Columns, until: float = np.inf) -> ClosingLoop | None:
    """Return the longest loop that has decided between the particles' histories, of those that closed before a stamp
    [s]; where none has, the longest. None where none closed, or in tables of older releases."""
    if "loop_length" not in steps:
        return None
    on = updates(steps)
    stamps, lengths = column(steps, "stamp")[on], np.nan_to_num(column(steps, "loop_length")[on])
    lengths = np.where(stamps < until, lengths, 0.0)
    closing = np.flatnonzero(lengths > 0.0)
    if len(closing) == 0:
        return None
    breaks = np.flatnonzero(np.abs(np.diff(stamps[closing])) >= CLOSING_S) + 1
    loops = [_loop(steps, on, lengths, group) for group in np.split(closing, breaks)]
    chosen = max([loop for loop in loops if loop.decided] or loops, key=lambda loop: loop.metres)
    return replace(chosen, longer=tuple(loop for loop in loops if loop.metres > chosen.metres))


def _loop(
    steps: Columns, on: NDArray[np.bool_], lengths: NDArray[np.float64], closing: NDArray[np.intp]
) -> ClosingLoop:
    """The loop that the updates `closing` (k,) close, by its length at each update (n,) [m]."""
    stamps = column(steps, "stamp")[on]
    full = int(closing[np.argmax(lengths[closing])])
    rows = np.arange(closing[0], len(stamps))
    rows = rows[(rows <= closing[-1]) | (np.abs(stamps[rows] - stamps[closing[-1]]) < CLOSING_S)]
    particles = int(column(steps, "particles")[on][rows[0]])
    died, resamplings, most = _deaths(steps, on, rows)
    spread, least = _spreads(steps, on, rows) if particles > 1 else (None, None)
    jump = _jump(steps, on, rows)
    loop = ClosingLoop(
        metres=float(lengths[full]),
        began=float(stamps[rows[0]]),
        stamp=float(stamps[full]),
        end=float(stamps[rows[-1]]),
        particles=particles,
        died=died,
        resamplings=resamplings,
        most_died=None if most is None else float(stamps[most]),
        most=0 if most is None else int(column(steps, "particles_died")[on][most]),
        jump=None if jump is None else (jump[0], float(stamps[jump[1]])),
        spread=spread,
        least_spread=None if least is None else (least[0], float(stamps[least[1]])),
        errors=None,
        jump_errors=None if jump is None else _errors(steps, on, jump[1], jump[1]),
    )
    settled = int(np.flatnonzero(stamps == loop.settled)[0])
    return replace(loop, errors=_errors(steps, on, int(rows[0]), settled))


def _deaths(steps: Columns, on: NDArray[np.bool_], rows: NDArray[np.intp]) -> tuple[int | None, int, int | None]:
    """How many particles died at these rows, at how many of them, and at which most; None = unknown, or none did."""
    if "particles_died" not in steps:
        return None, 0, None
    died = column(steps, "particles_died")[on][rows]
    return int(died.sum()), int(np.count_nonzero(died)), int(rows[np.argmax(died)]) if died.any() else None


def _jump(steps: Columns, on: NDArray[np.bool_], rows: NDArray[np.intp]) -> tuple[float, int] | None:
    """How far the reported pose moved at most at these rows because another particle became the best [m], and at
    which."""
    if "best_moved_m" not in steps:
        return None
    moved = np.nan_to_num(column(steps, "best_moved_m")[on][rows])
    at = int(np.argmax(moved))
    return (float(moved[at]), int(rows[at])) if moved[at] >= MIN_JUMP_M else None


def deaths_in_words(loop: ClosingLoop, told: float | None = None) -> str:
    """What the particles did at the time by which a loop is named: how many died, or that another one became the best;
    empty for a single particle, or where it is unknown.

    told: the stamp of an update [s] of which the reader knows already how far the reported pose moved
    """
    if loop.particles == 1 or loop.died is None:
        return ""
    if loop.most_died is not None:
        others = f" ({loop.died} in all {loop.resamplings} resamplings of the loop)" if loop.resamplings > 1 else ""
        return f"{loop.most} of {loop.particles} particles died{others}"
    if loop.jump is None:
        return "no particle died"
    metres, stamp = loop.jump
    moved = "" if stamp == told else f": the reported pose moved by {length(metres)}"
    return f"no particle died, and another became the best{moved}"


def longer_in_words(loop: ClosingLoop, start: float) -> str:
    """What became of the loops that were longer, since a start [s]: of the longest, and of the one in which most
    particles died; empty where there is none."""
    if not loop.longer:
        return ""
    longest = max(loop.longer, key=lambda other: other.metres)
    deadliest = max(loop.longer, key=lambda other: other.died or 0)
    named = [other for other in loop.longer if other is longest or (other is deadliest and other.died)]
    parts = [_undecided_in_words(other, start) for other in named]
    if len(loop.longer) > len(named):
        parts.append(f"and {len(loop.longer) - len(named)} more")
    loops = "a longer loop" if len(loop.longer) == 1 else "longer loops"
    least = f"{100.0 * MIN_FALL_M:.0f}\N{NO-BREAK SPACE}cm"
    what = loops if longest.spread is None else f"in {loops} the particles' spread fell by less than {least}"
    return f"{what}: {'; '.join(parts)}"


def _undecided_in_words(loop: ClosingLoop, start: float) -> str:
    """Length, time and deaths of a loop that has decided nothing, since a start [s]."""
    deaths = f", where {deaths_in_words(loop)}" if loop.died else ""
    return f"{loop.metres:.0f} m at {at_time(loop.to_watch - start)}{deaths}"


def _spreads(
    steps: Columns, on: NDArray[np.bool_], rows: NDArray[np.intp]
) -> tuple[float | None, tuple[float, int] | None]:
    """Spread at the first of these rows [m], and the smallest with its row; None where they are unknown."""
    if "spread_m" not in steps:
        return None, None
    spreads = column(steps, "spread_m")[on][rows]
    least = int(np.argmin(spreads))
    return float(spreads[0]), (float(spreads[least]), int(rows[least]))


def _errors(steps: Columns, on: NDArray[np.bool_], first: int, last: int) -> tuple[float, float] | None:
    """Errors [m] before the row `first`, and at the row `last`; None where they are unknown."""
    if "error_m" not in steps:
        return None
    errors = column(steps, "error_m")[on]
    before, after = float(errors[max(first - 1, 0)]), float(errors[last])
    return (before, after) if np.isfinite([before, after]).all() else None
