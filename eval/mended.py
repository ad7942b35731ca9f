# SPDX-License-Identifier: MIT
"""What was wrong in a run before its final pass mended it, by the pose while driving or the filter's own path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.failure_cause import another_best, find_cause
from eval.files.run_reader import read_steps
from eval.files.tum import read_tum
from eval.filter.step_table import Columns, column, updates
from eval.first_failure import find_failure
from eval.loss_watch import Spell, spells
from eval.trajectory.trajectory import Trajectory
from eval.wording import at_time, length, up_to_a_tenth

WORSE = ("lost", "broken loop", "drift")
"""Outcomes of an estimate that the final pass can mend, the worst first."""
ESTIMATES = (("online", "while driving"), ("filter", "on the filter's own path"))
"""Names of the estimates in files and keys, and in words."""


@dataclass(frozen=True)
class Course:
    """When the pose while driving was off the truth. Stamps [s]."""

    spells: tuple[Spell, ...]
    """Times in which it had drifted or was lost, in their order."""
    worst: float
    """When it was most wrong …"""
    metres: float
    """… and by how much [m]."""

    def in_words(self, start: float) -> str:
        """Say when it was first off, worst, and back, since a start [s]."""
        end = self.spells[-1].end
        back = "not back by the end" if end is None else f"back for good at {at_time(end - start)}"
        return (
            f"the pose was first off the truth at {at_time(self.spells[0].start - start)}, worst at "
            f"{at_time(self.worst - start)} ({length(self.metres)}), and {back}"
        )


@dataclass(frozen=True)
class Mended:
    """What was wrong before the final pass."""

    outcome: str
    which: str
    """The estimate that it is the outcome of, in words."""
    stamp: float
    """The moment [s]."""
    time_to_watch: float
    """The same since the first scan [s], rounded up to a tenth: when a viewer shows it."""
    reason: str
    """A sentence with the numbers."""
    cause: str | None
    """What the data show at the moment, see `eval.failure_cause`."""
    course: Course | None
    """When the pose while driving was off; None where it is the filter's own path, or where that is unknown."""
    errors: tuple[float, float] | None
    """Position error of the pose while driving at the update before the moment and at it [m]; None likewise."""


def find_mended(metrics: Mapping[str, Any], run: Path) -> Mended | None:
    """Return what was wrong before the final pass of a run; None where nothing was, where the final estimate is wrong
    too, or where no truth is known.

    run: its directory. The moment is the first one from which the pose while driving, else the filter's own path, does
    not come back to the truth; where they all came back, the beginning of the longest drift, and where the error falls
    at that moment, the beginning of the drift in which the pose was most wrong.
    Raises ValueError for damaged files.
    """
    if metrics.get("outcome") not in ("ok", "drift") or not (run / "truth.tum").is_file():
        return None
    worse = WORSE if metrics["outcome"] == "ok" else WORSE[:2]
    truth, steps = read_tum(run / "truth.tum"), read_steps(run / "steps.parquet")
    odometry = read_tum(run / "odometry.tum") if (run / "odometry.tum").is_file() else None
    for name, which in ESTIMATES:
        outcome, path = str(metrics.get(f"outcome_{name}")), run / f"{name}.tum"
        if outcome not in worse or not path.is_file():
            continue
        estimate = read_tum(path)
        failure = find_failure(estimate, truth=truth, steps=steps)
        if failure is None or not failure.bad:
            drifts = [] if steps is None else spells(steps, "drifted")
            if steps is None or not drifts:
                continue
            end = float(estimate.stamps[-1])
            longest = max(drifts, key=lambda spell: (spell.end or end) - spell.start)
            return _drift(outcome, which, estimate, steps, longest)
        whole = steps if steps is not None and "hits" in steps else None  # tables of older releases have none
        jump = another_best(failure.stamp, steps) if name == "online" else None
        cause = jump or find_cause(failure.stamp, odometry=odometry, reference=truth, steps=whole, estimate=estimate)
        time = up_to_a_tenth(failure.stamp - float(estimate.stamps[0]))
        course, errors = None, None
        if name == "online" and steps is not None:
            course, errors = _course(steps), _errors_at(failure.stamp, steps)
            if course is not None and errors is not None and errors[1] < errors[0]:  # a way back, not the way off
                worst = next(spell for spell in course.spells if spell.end is None or course.worst <= spell.end)
                start = worst.start
                cause = find_cause(start, odometry=odometry, reference=truth, steps=whole, estimate=estimate)
                return _drift(outcome, which, estimate, steps, worst, cause)
        return Mended(outcome, which, failure.stamp, time, failure.reason, cause, course, errors)
    return None


def _drift(
    outcome: str, which: str, estimate: Trajectory, steps: Columns, spell: Spell, cause: str | None = None
) -> Mended:
    """A time in which the pose while driving had drifted; its moment is the beginning."""
    until = float(estimate.stamps[-1]) if spell.end is None else spell.end
    reason = f"the pose while driving drifts for {until - spell.start:.0f} s, by up to {drift_in(steps, [spell]):.2f} m"
    time = up_to_a_tenth(spell.start - float(estimate.stamps[0]))
    return Mended(outcome, which, spell.start, time, reason, cause, _course(steps), _errors_at(spell.start, steps))


def _errors_at(stamp: float, steps: Columns) -> tuple[float, float] | None:
    """Position errors of the pose while driving at the update before a stamp [s] and at it [m]; None where unknown."""
    rows = updates(steps)
    now = int(np.searchsorted(column(steps, "stamp")[rows], stamp - 1e-6))
    if "error_m" not in steps or not 0 < now < rows.sum():
        return None
    before, at = column(steps, "error_m")[rows][now - 1 : now + 1].tolist()
    return (before, at) if np.isfinite([before, at]).all() else None


def _course(steps: Columns) -> Course | None:
    """When the pose while driving was off; None where it never was."""
    found = sorted(spells(steps, "drifted") + spells(steps, "lost"), key=lambda spell: spell.start)
    if not found:
        return None
    stamps, errors = column(steps, "stamp"), np.where(_within(steps, found), column(steps, "error_m"), np.nan)
    worst = int(np.nanargmax(errors))
    return Course(tuple(found), float(stamps[worst]), float(errors[worst]))


def drift_in(steps: Columns, found: list[Spell]) -> float:
    """Largest position error of the pose while driving in these times [m]."""
    return float(np.nanmax(column(steps, "error_m")[_within(steps, found)]))


def _within(steps: Columns, found: list[Spell]) -> NDArray[np.bool_]:
    """The updates in these times, as a mask (n,)."""
    stamps = column(steps, "stamp")
    within = np.zeros(len(stamps), np.bool_)
    for spell in found:
        within |= (stamps >= spell.start) & (stamps <= (np.inf if spell.end is None else spell.end))
    return within & updates(steps)
