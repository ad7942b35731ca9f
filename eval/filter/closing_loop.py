# SPDX-License-Identifier: MIT
"""What the particles did while the largest loop of a run closed, from its table of steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eval.filter.step_table import Columns, column, updates

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
    """Stamp of the resampling in which most of them died; None where none did."""
    spread: float | None
    """Spread of the particles when it began [m]; None where that is unknown."""
    least_spread: tuple[float, float] | None
    """Their smallest spread in it [m], and its stamp."""
    errors: tuple[float, float] | None
    """Error of the pose while driving before the loop, and when it had its full length [m]; None without truth."""
    longer: float | None = None
    """Length of the longest loop [m] where that is another one, in which no particle died; None = it is this one."""

    @property
    def to_watch(self) -> float:
        """Stamp at which to watch it: the resampling in which most particles died, else the scan that closed it."""
        return self.stamp if self.most_died is None else self.most_died


def largest_closing_loop(steps: Columns, until: float = np.inf) -> ClosingLoop | None:
    """Return the longest loop in which particles died, of those that closed before a stamp [s]; where none died in any,
    the longest. None where none closed, or in tables of older releases."""
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
    longest = max(loops, key=lambda loop: loop.metres)
    chosen = max((loop for loop in loops if loop.died), key=lambda loop: loop.metres, default=longest)
    return chosen if chosen is longest else replace(chosen, longer=longest.metres)


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
    return ClosingLoop(
        metres=float(lengths[full]),
        began=float(stamps[rows[0]]),
        stamp=float(stamps[full]),
        end=float(stamps[rows[-1]]),
        particles=particles,
        died=died,
        resamplings=resamplings,
        most_died=None if most is None else float(stamps[most]),
        spread=spread,
        least_spread=None if least is None else (least[0], float(stamps[least[1]])),
        errors=_errors(steps, on, int(rows[0]), full),
    )


def _deaths(steps: Columns, on: NDArray[np.bool_], rows: NDArray[np.intp]) -> tuple[int | None, int, int | None]:
    """How many particles died at these rows, at how many of them, and at which most; None = unknown, or none did."""
    if "particles_died" not in steps:
        return None, 0, None
    died = column(steps, "particles_died")[on][rows]
    return int(died.sum()), int(np.count_nonzero(died)), int(rows[np.argmax(died)]) if died.any() else None


def _spreads(
    steps: Columns, on: NDArray[np.bool_], rows: NDArray[np.intp]
) -> tuple[float | None, tuple[float, int] | None]:
    """Spread at the first of these rows [m], and the smallest with its row; None where they are unknown."""
    if "spread_m" not in steps:
        return None, None
    spreads = column(steps, "spread_m")[on][rows]
    least = int(np.argmin(spreads))
    return float(spreads[0]), (float(spreads[least]), int(rows[least]))


def _errors(steps: Columns, on: NDArray[np.bool_], first: int, full: int) -> tuple[float, float] | None:
    """Errors [m] before the row `first`, and at the row `full`; None where they are unknown."""
    if "error_m" not in steps:
        return None
    errors = column(steps, "error_m")[on]
    before, after = float(errors[max(first - 1, 0)]), float(errors[full])
    return (before, after) if np.isfinite([before, after]).all() else None
