# SPDX-License-Identifier: MIT
"""What was wrong in a run before its final pass mended it, by the pose while driving or the filter's own path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.failure_cause import find_cause
from eval.files.run_reader import read_steps
from eval.files.tum import read_tum
from eval.filter.step_table import Columns, column
from eval.first_failure import find_failure
from eval.loss_watch import Spell, spells
from eval.trajectory.trajectory import Trajectory
from eval.wording import up_to_a_tenth

WORSE = ("lost", "broken loop", "drift")
"""Outcomes of an estimate that the final pass can mend, the worst first."""
ESTIMATES = (("online", "while driving"), ("filter", "on the filter's own path"))
"""Names of the estimates in files and keys, and in words."""


@dataclass(frozen=True)
class Mended:
    """What was wrong before the final pass."""

    outcome: str
    which: str
    """The estimate that it is the outcome of, in words."""
    stamp: float
    """The moment [s]."""
    time_to_watch: float
    """When a viewer shows it, since the first scan [s]."""
    reason: str
    """A sentence with the numbers."""
    cause: str | None
    """What the data show at the moment, see `eval.failure_cause`."""


def find_mended(metrics: Mapping[str, Any], run: Path) -> Mended | None:
    """Return what was wrong before the final pass of a run; None where nothing was, where the final estimate is wrong
    too, or where no truth is known.

    run: its directory. The moment is the first one from which the pose while driving, else the filter's own path, does
    not come back to the truth; where they all came back, the beginning of the longest drift.
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
            if steps is not None and (found := _longest_drift(outcome, which, estimate, steps)) is not None:
                return found
            continue
        whole = steps if steps is not None and "hits" in steps else None  # tables of older releases have none
        cause = find_cause(failure.stamp, odometry=odometry, reference=truth, steps=whole, estimate=estimate)
        time = failure.time_to_watch(estimate.stamps)
        assert time is not None  # the failure is that of one of its scans
        return Mended(outcome, which, failure.stamp, time, failure.reason, cause)
    return None


def _longest_drift(outcome: str, which: str, estimate: Trajectory, steps: Columns) -> Mended | None:
    """The longest time in which the pose while driving had drifted; None where it never had."""
    end = float(estimate.stamps[-1])
    found = spells(steps, "drifted")
    if not found:
        return None
    longest = max(found, key=lambda spell: (spell.end or end) - spell.start)
    until = longest.end or end
    reason = (
        f"the pose while driving drifts for {until - longest.start:.0f} s, by up to {drift_in(steps, [longest]):.2f} m"
    )
    time = up_to_a_tenth(longest.start - float(estimate.stamps[0]))
    return Mended(outcome, which, longest.start, time, reason, None)


def drift_in(steps: Columns, found: list[Spell]) -> float:
    """Largest position error of the pose while driving in these times [m]."""
    stamps: NDArray[np.float64] = column(steps, "stamp")
    within = np.zeros(len(stamps), np.bool_)
    for spell in found:
        within |= (stamps >= spell.start) & (stamps <= (np.inf if spell.end is None else spell.end))
    return float(np.nanmax(column(steps, "error_m")[within]))
