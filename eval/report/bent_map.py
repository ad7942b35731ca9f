# SPDX-License-Identifier: MIT
"""What had gone wrong before the moment at which a run failed: a map that was bent, wheels that slipped."""

from __future__ import annotations

from eval.failure_cause import BEFORE_S, RECOVERED, earlier_slips
from eval.filter.step_table import Columns
from eval.first_failure import Failure
from eval.loss_watch import Spell, spells
from eval.mended import drift_in
from eval.report.check_story import times_in_words
from eval.trajectory.trajectory import Trajectory
from eval.wording import at_time, length


def bent_before(steps: Columns | None, failure: Failure, start: float) -> str:
    """Say when the pose while driving had drifted before a failure, since a start [s], and by how much; empty where it
    had not, or where that is unknown. Where it had, its map was bent."""
    if steps is None or not failure.bad or "error_m" not in steps:
        return ""
    before = [
        Spell(spell.start, min(spell.end or failure.stamp, failure.stamp))
        for spell in spells(steps, "drifted")
        if spell.start < failure.stamp
    ]
    if not before:
        return ""
    times = times_in_words(before, start)
    return f"the pose while driving had drifted {times}, by up to {length(drift_in(steps, before))}"


def cause_in_short(failure: Failure, bent: str) -> str:
    """The cause of a failure in a few words; bent: how its map was bent before, empty where it was not.

    Slips that the estimate had got over before are not what made it fail where the map was bent meanwhile.
    """
    if not failure.cause:
        return ""
    short = failure.cause.split(":")[0]
    return f"the map was bent, and {short}" if bent and RECOVERED in failure.cause else short


def times_of_failure(failure: Failure, start: float) -> str:
    """When the estimate is wrong, since a start [s]: `from 235.9 s to 248.0 s`, or `from 235.9 s on`."""
    end = "on" if failure.back is None else f"to {at_time(failure.back - start)}"
    return f"from {at_time(failure.stamp - start)} {end}"


def behind_failure(
    failure: Failure, start: float, steps: Columns | None, odometry: Trajectory | None, truth: Trajectory | None
) -> str:
    """Say what had gone wrong before a failure, since a start [s]: in its map, and with the wheels; empty where nothing
    had, or where that is unknown."""
    bent = bent_before(steps, failure, start)
    parts = [f"the map was bent: {bent}"] if bent else []
    if odometry is not None and truth is not None:
        slips, _ = earlier_slips(odometry, truth, failure.stamp - BEFORE_S)  # as its cause says
        if slips:
            parts.append(f"the wheels had slipped in {slips} before it")
    return "; ".join(parts)
