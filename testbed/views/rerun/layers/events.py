# SPDX-License-Identifier: MIT
"""What happens in a run, as lines of a log with levels, and as states that change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from eval.first_failure import MIN_HEAL_PATH
from eval.loss_watch import LASTING_M, Change, LossWatch
from slam.step.step_report import StepReport
from testbed.views.rerun import entities
from testbed.views.rerun.layers.loop_watch import LoopLine, count_of
from testbed.views.rerun.layers.prediction import Time
from testbed.views.rerun.layers.repeats import Repeats
from testbed.views.view import FinalLoop, Snapshot

Level = Literal["INFO", "WARN", "ERROR"]


class Line(NamedTuple):
    """A line of the event log."""

    level: Level
    text: str
    at: Time | None = None
    """When it happened; None = now."""


class StateChange(NamedTuple):
    """A lane whose state has changed."""

    lane: str
    state: str
    at: Time | None = None
    """When it changed; None = now."""


GOOD, DRIFTED, LOST = "close to the truth (limit 35 cm)", "has drifted", "lost"
MATCHED, POORLY_MATCHED, MATCH_FAILED = "scan fits the map", "scan fits poorly", "matching failed"
DRIVING, COLLIDED = "driving", "collided"
PLAUSIBLE, DOUBTFUL, CALLED_LOST = "plausible", "doubtful", "says lost"
SEARCHING, AMBIGUOUS, FOUND = "searching", "ambiguous", "found"
MIN_SHARE = 0.8
"""A scan fits poorly if less than this part of the usual share of its beams meet walls of the map …"""
MIN_USUAL = 20
"""… which is known after this many updates."""


JUMPS_QUIET_S = 60.0
"""Wheels that slip do so again and again: after a line about motion that no robot drives there is none for this long
[s]."""
_STATES = {"close": GOOD, "drifted": DRIFTED, "lost": LOST}
_SELF_CHECK = {"plausible": PLAUSIBLE, "doubtful": DOUBTFUL, "lost": CALLED_LOST}


@dataclass
class EventWatch:
    """Turns snapshots into lines and states."""

    states: dict[str, str] = field(default_factory=dict)
    _loss: LossWatch = field(default_factory=LossWatch)
    _compared: list[Time] = field(default_factory=list)  # times of the updates that were compared with the truth
    _jumps: Repeats = field(default_factory=lambda: Repeats(JUMPS_QUIET_S))
    _shares: list[float] = field(default_factory=list)
    _usual: float = 0.0
    _poor: int = 0

    def update(
        self, snapshot: Snapshot, now: Time, died: int, loops: Sequence[LoopLine] = ()
    ) -> tuple[list[Line], list[StateChange]]:
        """Lines for the event log, and the lanes whose state has changed.

        now: the snapshot's time;  died: particles that this update killed;  loops: lines about loops that close
        """
        lines = [Line("WARN", note) for note in snapshot.notes]
        found = self.states.get(entities.LOCALIZATION_STATE, FOUND) == FOUND
        changes: list[StateChange] = []
        states: dict[str, str] = {}
        step = snapshot.step
        if snapshot.truth is not None and found and step is not None and step.updated:
            states[entities.ESTIMATE_STATE] = self.states.get(entities.ESTIMATE_STATE, GOOD)
            self._compared.append(now)
            change = self._loss.update(snapshot.truth.tolist(), snapshot.estimate.tolist())
            if change is not None:
                since = self._compared[change.since]
                changes.append(StateChange(entities.ESTIMATE_STATE, _STATES[self._loss.state], since))
                if (line := _loss_line(change, since)) is not None:
                    lines.append(line)
        if step is not None and step.odometry_jumped:
            lines += self._jump_lines(now)
        if step is not None and step.updated:
            lines += _filter_lines(step, died, loops)
            lines += self._self_check_lines(step)
            if step.self_check is not None:
                states[entities.SELF_CHECK_STATE] = _SELF_CHECK[step.self_check.verdict]
            states[entities.MATCHING_STATE] = self._matching_state(step)
        if snapshot.localization is not None:
            states[entities.LOCALIZATION_STATE] = snapshot.localization
            lines += self._localization_lines(snapshot.localization)
        states[entities.ROBOT_STATE] = COLLIDED if snapshot.collided else DRIVING
        now_other = [StateChange(lane, state) for lane, state in states.items() if self.states.get(lane) != state]
        changes = now_other + [change for change in changes if self.states.get(change.lane) != change.state]
        changed = {change.lane: change.state for change in changes}
        if changed.get(entities.MATCHING_STATE) == POORLY_MATCHED:
            share = f"{self._shares[-1]:.0%} of the hits meet its walls (usual: {self._usual:.0%})"
            lines.append(Line("WARN", f"the scans fit the map poorly: {share}"))
        if changed.get(entities.ROBOT_STATE) == COLLIDED:
            lines.append(Line("ERROR", "the robot has collided"))
        self.states |= changed
        return lines, changes

    @property
    def lost(self) -> bool:
        """Whether the estimate was lost at the last update: by the truth, else by the filter's own check."""
        judged = self.states.get(entities.ESTIMATE_STATE)
        return judged == LOST if judged is not None else self.states.get(entities.SELF_CHECK_STATE) == CALLED_LOST

    def _jump_lines(self, now: Time) -> list[Line]:
        """A line about motion that no robot drives, unless it was said of late."""
        before = self._jumps.say(now[0])
        if before is None:
            return []
        return [Line("WARN", f"the odometry moved further between two scans than a robot drives: left out{before}")]

    def _self_check_lines(self, step: StepReport) -> list[Line]:
        """A line where the filter's own check begins to call the estimate lost."""
        check = step.self_check
        if check is None or check.verdict != "lost" or self.states.get(entities.SELF_CHECK_STATE) == CALLED_LOST:
            return []
        return [Line("WARN", f"the self-check says lost: {check.reason}")]

    def _matching_state(self, step: StepReport) -> str:
        """How the scan fits the map; a single scan that fits poorly changes nothing."""
        if step.proposed is None:
            return MATCHED
        if 2 * step.match_failures > step.particles:
            return MATCH_FAILED
        self._shares.append(step.matched_share)
        if len(self._shares) % MIN_USUAL == 0:
            self._usual = float(np.median(self._shares))
        self._poor = self._poor + 1 if step.matched_share < MIN_SHARE * self._usual else 0
        return POORLY_MATCHED if self._poor >= 2 else MATCHED

    def _localization_lines(self, state: str) -> list[Line]:
        before = self.states.get(entities.LOCALIZATION_STATE)
        if state == before:
            return []
        if state == SEARCHING and before == FOUND:
            return [Line("ERROR", "lost: the scans no longer fit the map at the estimated pose; searching again")]
        return [Line("INFO", f"localisation: {state}")]


def final_lines(loops: Sequence[FinalLoop]) -> list[Line]:
    """What is said of a final pass and of the loops that it found."""
    kinds = [loop.kind for loop in loops]
    counts = {kind: kinds.count(kind) for kind in ("closed_by_filter", "left_open", "rejected")}
    lines = [Line("INFO", "final pass: map and path before and after it are in the tab Final pass")]
    if counts["closed_by_filter"]:
        lines.append(Line("INFO", f"final pass: {_loops(counts['closed_by_filter'])} found that the filter had closed"))
    if counts["left_open"]:
        lines.append(Line("WARN", f"final pass: {_loops(counts['left_open'])} closed that the filter had left open"))
    if counts["rejected"]:
        lines.append(Line("INFO", f"final pass: {_loops(counts['rejected'])} rejected"))
    return lines


def _loops(count: int) -> str:
    return f"{count} loop{'' if count == 1 else 's'}"


def _loss_line(change: Change, since: Time) -> Line | None:
    if change.kind in ("drifted", "close"):
        return None
    amount = _amount(change.metres, change.degrees)
    if change.kind == "found":
        return Line("INFO", f"found again: {amount} off; it fits the truth over {MIN_HEAL_PATH:.0f} m from here", since)
    begin = "lost" if change.kind == "lost" else "thrown further off"
    at_first = "" if change.at_first is None else f"{_amount(*change.at_first)} now, by "
    soon = "" if change.at_first is None else f" {LASTING_M} m later"
    return Line("ERROR", f"{begin}: the motion over the last metre is wrong by {at_first}{amount}{soon}", since)


def _amount(metres: float, degrees: float) -> str:
    return f"{metres:.2f} m and {degrees:.0f}°"


def _filter_lines(step: StepReport, died: int, loops: Sequence[LoopLine]) -> list[Line]:
    """What the filter did at an update."""
    lines: list[Line] = []
    if step.resampled:
        size = f"effective sample size {step.ess:.1f} of {step.particles}"
        lines.append(Line("INFO", f"resampled: {size}; {count_of(died)} died"))
    lines += [Line(*line) for line in loops]
    if step.match_failures:
        lines.append(Line("WARN", f"scan matching failed for {step.match_failures} of {step.particles} particles"))
    return lines
