# SPDX-License-Identifier: MIT
"""What happens in a run, as lines of a log with levels, and as states that change."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from eval.outcome import LOCAL_DEG, LOCAL_M
from slam import se2
from slam.se2 import Pose
from slam.step.step_report import StepReport
from testbed.views.rerun import entities
from testbed.views.rerun.layers.loop_watch import count_of
from testbed.views.view import Snapshot

Level = Literal["INFO", "WARN", "ERROR"]
Line = tuple[Level, str]

GOOD, LOST, UNKNOWN_TRUTH = "follows the truth", "lost", "truth unknown"
MATCHED, POORLY_MATCHED, MATCH_FAILED = "scan fits the map", "scan fits poorly", "matching failed"
DRIVING, COLLIDED = "driving", "collided"
SEARCHING, AMBIGUOUS, FOUND = "searching", "ambiguous", "found"
PATH_M = 1.0
"""The estimate is compared with the truth over this much of the path [m]."""
LASTING_M = 0.2
"""It is lost once it has been off over this much of the path: another particle may be the best for a moment [m]."""
MIN_SHARE = 0.5
"""A scan fits poorly if less than this part of the usual share of its beams meet walls of the map …"""
MIN_USUAL = 20
"""… which is known after this many updates."""


@dataclass
class LossWatch:
    """Compares the estimated motion over the last metre with the true one: says when the estimate is lost, and when
    it comes back to where it was before."""

    _recent: deque[tuple[float, Pose, Pose]] = field(default_factory=deque)  # distance driven, truth, estimate
    _T_truth_map: Pose | None = None  # alignment from before the loss, while lost
    _changed_at: float | None = None  # distance driven where the error began to say otherwise than `lost`
    lost: bool = False

    def update(self, travelled: float, truth: Pose, estimate: Pose) -> tuple[float, float] | None:
        """Take in a pose; the error [m, deg] where the state `lost` has just changed, else None."""
        recent = self._recent
        recent.append((travelled, truth, estimate))
        while len(recent) > 1 and travelled - recent[1][0] >= PATH_M:
            recent.popleft()
        if self._T_truth_map is not None:
            T_truth_map = self._T_truth_map
        else:
            _, true_start, estimated_start = recent[0]
            T_truth_map = se2.compose(true_start, se2.inverse(estimated_start))
        miss = se2.between(truth, se2.compose(T_truth_map, estimate))
        metres, degrees = float(np.hypot(miss[0], miss[1])), abs(float(np.degrees(miss[2])))
        bad = metres > LOCAL_M or degrees > LOCAL_DEG
        if bad == self.lost:
            self._changed_at = None
            return None
        if self._changed_at is None:
            self._changed_at = travelled
        if bad and travelled - self._changed_at < LASTING_M:
            return None
        self.lost, self._T_truth_map, self._changed_at = bad, T_truth_map if bad else None, None
        if not bad:
            recent.clear()
        return metres, degrees


@dataclass
class EventWatch:
    """Turns snapshots into lines and states."""

    states: dict[str, str] = field(default_factory=dict)
    _loss: LossWatch = field(default_factory=LossWatch)
    _shares: list[float] = field(default_factory=list)
    _usual: float = 0.0
    _poor: int = 0

    @property
    def lost(self) -> bool:
        """Whether the estimate has left the truth, as far as that is known."""
        return self._loss.lost

    def update(
        self, snapshot: Snapshot, travelled: float, died: int, loops: Sequence[str] = ()
    ) -> tuple[list[Line], dict[str, str]]:
        """Lines for the event log, and the lanes whose state has changed.

        travelled: distance driven so far [m];  died: particles that this update killed
        loops: sentences about loops that close
        """
        lines: list[Line] = [("WARN", note) for note in snapshot.notes]
        states: dict[str, str] = {}
        found = self.states.get(entities.LOCALIZATION_STATE, FOUND) == FOUND
        if snapshot.truth is not None and found and snapshot.step is not None and snapshot.step.updated:
            change = self._loss.update(travelled, snapshot.truth, snapshot.estimate)
            states[entities.ESTIMATE_STATE] = LOST if self._loss.lost else GOOD
            if change is not None:
                lines.append(_loss_line(self._loss.lost, *change))
        step = snapshot.step
        if step is not None and step.odometry_jumped:
            lines.append(("WARN", "the odometry has jumped, as where its driver starts again: it goes on from there"))
        if step is not None and step.updated:
            lines += _filter_lines(step, died, loops)
            states[entities.MATCHING_STATE] = self._matching_state(step)
        if snapshot.localization is not None:
            states[entities.LOCALIZATION_STATE] = snapshot.localization
            lines += self._localization_lines(snapshot.localization)
        states[entities.ROBOT_STATE] = COLLIDED if snapshot.collided else DRIVING
        changed = {lane: state for lane, state in states.items() if self.states.get(lane) != state}
        if changed.get(entities.MATCHING_STATE) == POORLY_MATCHED:
            lines.append(("WARN", "the scans fit the map poorly: few of their beams meet its walls"))
        if changed.get(entities.ROBOT_STATE) == COLLIDED:
            lines.append(("ERROR", "the robot has collided"))
        self.states |= changed
        return lines, changed

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
            return [("ERROR", "lost: the scans no longer fit the map at the estimated pose; searching again")]
        return [("INFO", f"localisation: {state}")]


def _loss_line(lost: bool, metres: float, degrees: float) -> Line:
    amount = f"{metres:.2f} m and {degrees:.0f} degrees"
    if lost:
        return "ERROR", f"lost: the pose while driving is off by {amount} over the last metre of path"
    return "INFO", "the estimate has come back to the truth"


def _filter_lines(step: StepReport, died: int, loops: Sequence[str]) -> list[Line]:
    """What the filter did at an update."""
    lines: list[Line] = []
    if step.resampled:
        size = f"effective sample size {step.ess:.1f} of {step.particles}"
        lines.append(("INFO", f"resampled: {size}; {count_of(died)} died"))
    lines += [("INFO", sentence) for sentence in loops]
    if step.match_failures:
        lines.append(("WARN", f"scan matching failed for {step.match_failures} of {step.particles} particles"))
    return lines
