# SPDX-License-Identifier: MIT
"""What was wrong in a run before its final pass mended it, by the pose while driving or the filter's own path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eval.failure_cause import find_cause
from eval.files.run_reader import read_steps
from eval.files.tum import read_tum
from eval.filter.step_table import Columns, column, updates
from eval.first_failure import find_failure
from eval.loss_watch import Spell
from eval.trajectory.association import AssociationError
from eval.trajectory.trajectory import Trajectory
from eval.while_driving import Drive, WhileDriving, judge_while_driving
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
    start: float
    """Stamp of the first scan [s]."""
    cause: str
    """What happened at the moment, as a sentence with numbers."""
    driving: WhileDriving | None
    """When the pose while driving was off; None where it is the filter's own path, or where that is unknown."""

    @property
    def time_to_watch(self) -> float:
        """The moment since the first scan [s], rounded up to a tenth: when a viewer shows it."""
        return up_to_a_tenth(self.stamp - self.start)


def find_mended(metrics: Mapping[str, Any], run: Path) -> Mended | None:
    """Return what was wrong before the final pass of a run; None where nothing was, where the final estimate is wrong
    too, or where no truth is known.

    run: its directory. The moment is the beginning of the time from which most of the evidence for the outcome while
    driving comes; of the filter's own path, or without a table of steps, the first one from which the estimate does not
    come back to the truth.
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
        start = float(estimate.stamps[0])
        driving = _driving(outcome, estimate, truth, steps, odometry) if name == "online" else None
        if driving is not None:
            most = driving.stretches[0]
            return Mended(outcome, which, most.moment, start, most.cause, driving)
        failure = find_failure(estimate, truth=truth, steps=steps)
        if failure is not None and failure.bad:
            whole = steps if steps is not None and "hits" in steps else None  # tables of older releases have none
            cause = find_cause(failure.stamp, odometry=odometry, reference=truth, steps=whole, estimate=estimate)
            words = failure.reason if cause is None else f"{failure.reason}; {cause}"
            return Mended(outcome, which, failure.stamp, start, words, None)
    return None


def _driving(
    outcome: str, online: Trajectory, truth: Trajectory, steps: Columns | None, odometry: Trajectory | None
) -> WhileDriving | None:
    if steps is None:
        return None
    try:
        return judge_while_driving(outcome, Drive(online, truth, steps, odometry))
    except AssociationError:
        return None


def drift_in(steps: Columns, found: list[Spell]) -> float:
    """Largest position error of the pose while driving in these times [m]."""
    stamps = column(steps, "stamp")
    within = np.zeros(len(stamps), np.bool_)
    for spell in found:
        within |= (stamps >= spell.start) & (stamps <= (np.inf if spell.end is None else spell.end))
    return float(np.nanmax(column(steps, "error_m")[within & updates(steps)]))
