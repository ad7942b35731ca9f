# SPDX-License-Identifier: MIT
"""Follow the pose while driving against the truth, update by update: where it is lost, and where it is found again."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from eval.filter.step_table import Columns, column, pose_columns, updates
from eval.first_failure import MIN_HEAL_PATH, has_come_back
from eval.outcome import LOCAL_DEG, LOCAL_M

Floats = Sequence[float]
"""A pose (x, y, theta) as plain numbers: numpy takes ten times as long for three of them."""

PATH_M = 1.0
"""The estimated motion over this much of the path is compared with the true one [m]."""
NEAR_M = 0.25
"""The pose so far back is the middle one of those within this distance of it: a pose that is off for a moment, as
another particle is the best, spoils no comparison [m]."""
LASTING_M = 0.2
"""The estimate is lost once it has been off over this much of the path [m]."""
SPACING_M = 0.04
"""Poses nearer to the one before are not compared with [m]."""


class Change(NamedTuple):
    """The estimate has been lost, was thrown further off while it was lost, or has been found again; while it is not
    lost, it has drifted away from the truth, or is close to it again."""

    kind: Literal["lost", "further", "found", "drifted", "close"]
    since: int
    """Number of the update at which it began; it is known a little later."""
    metres: float
    """How wrong the motion over the last metre is [m]; unless it is lost, how wrong the pose is."""
    degrees: float
    at_first: tuple[float, float] | None = None
    """The same at the update at which it began; None unless it has been lost, or was thrown further off."""


@dataclass
class LossWatch:
    """Says when the estimate is lost, and when it is found again.

    It is lost where, over `LASTING_M` of path in a row, its motion over the last metre is wrong by more than `LOCAL_M`
    or `LOCAL_DEG`. It is found again where, over `MIN_HEAL_PATH` in a row, it fits the truth as it did before it was
    lost, or as it did at the start (`eval.first_failure.has_come_back`). To jump to where it fits as at the start is no
    loss: that part of the map is right, the one before was not. It has drifted where, over `LASTING_M` in a row, it
    does not fit the truth as it did at the start.
    """

    state: Literal["close", "drifted", "lost"] = "close"
    _updates: int = 0
    _travelled: float = 0.0
    _last_truth: Floats | None = None
    _recent: deque[tuple[float, Floats]] = field(default_factory=deque)  # distance driven, T_truth_map
    _known: list[Floats] = field(default_factory=list)  # T_truth_map at the start, and before the loss
    _lost_at: float = 0.0  # distance driven
    # update and distance since which it is off, T_truth_map before, and how far it was off then
    _off: tuple[int, float, Floats, tuple[float, float]] | None = None
    _off_known: bool = False  # whether that was said
    _back: tuple[int, float] | None = None  # update and distance since which it fits again
    _turned: tuple[int, float] | None = None  # update and distance since which it has drifted, or has not any more

    def update(self, truth: Floats, estimate: Floats) -> Change | None:
        """Take in the poses (3,) of an update, each in its own frame; what has changed by it."""
        number, self._updates = self._updates, self._updates + 1
        if self._last_truth is not None:
            self._travelled += math.dist(truth[:2], self._last_truth[:2])
        self._last_truth = truth
        T_truth_map = _alignment(truth, estimate)
        if not self._known:
            self._known = [T_truth_map]
        before = self._alignment_before(T_truth_map)
        change = self._found(number, truth, estimate) if self.lost else None
        return change or self._departed(number, truth, estimate, before) or self._drifted(number, truth, estimate)

    @property
    def lost(self) -> bool:
        """Whether the estimate is lost."""
        return self.state == "lost"

    def _departed(self, number: int, truth: Floats, estimate: Floats, T_truth_map: Floats) -> Change | None:
        """Whether the motion over the last metre has been wrong for long enough, given the alignment before it."""
        metres, degrees = _miss(truth, estimate, T_truth_map)
        if (metres <= LOCAL_M and degrees <= LOCAL_DEG) or self._fits(truth, estimate) is not None:
            self._off, self._off_known = None, False
            return None
        if self._off is None:
            self._off = number, self._travelled, T_truth_map, (metres, degrees)
        since, distance, before, at_first = self._off
        if self._off_known or self._travelled - distance < LASTING_M:
            return None
        self._off_known = True
        if self.lost:
            return Change("further", since, metres, degrees, at_first)
        self.state, self._lost_at, self._turned = "lost", distance, None
        self._known = [self._known[0], before]
        return Change("lost", since, metres, degrees, at_first)

    def _found(self, number: int, truth: Floats, estimate: Floats) -> Change | None:
        """Whether the estimate has fitted the truth again for long enough."""
        miss = self._fits(truth, estimate)
        if miss is None:
            self._back = None
            return None
        if self._back is None:
            self._back = number, self._travelled
        since, distance = self._back
        if self._travelled - distance < MIN_HEAL_PATH:
            return None
        self._known, self._back = self._known[:1], None
        self._recent.clear()
        self.state = "close" if self._fits(truth, estimate) else "drifted"
        return Change("found", since, *miss)

    def _drifted(self, number: int, truth: Floats, estimate: Floats) -> Change | None:
        """Whether the estimate has drifted away from the truth, or is close to it again."""
        if self.lost or (self._fits(truth, estimate) is not None) == (self.state == "close"):
            self._turned = None
            return None
        if self._turned is None:
            self._turned = number, self._travelled
        since, distance = self._turned
        if self._travelled - distance < LASTING_M:
            return None
        self._turned, self.state = None, "drifted" if self.state == "close" else "close"
        return Change(self.state, since, *_miss(truth, estimate, self._known[0]))

    def _fits(self, truth: Floats, estimate: Floats) -> tuple[float, float] | None:
        """How far the estimate is off [m, deg] if it fits the truth as at the start or before a loss; else None."""
        driven = self._travelled - self._lost_at if self.lost else self._travelled
        misses = [_miss(truth, estimate, T_truth_map) for T_truth_map in self._known]
        return min((miss for miss in misses if has_come_back(*miss, driven)), default=None)

    def _alignment_before(self, T_truth_map: Floats) -> Floats:
        """T_truth_map a metre of path before, the middle one of those about it; adds the one of now."""
        recent, now = self._recent, self._travelled
        while len(recent) > 1 and recent[1][0] <= now - PATH_M - NEAR_M:
            recent.popleft()
        if not recent or now - recent[-1][0] >= SPACING_M:
            recent.append((now, T_truth_map))
        near = [pose for travelled, pose in recent if abs(now - PATH_M - travelled) <= NEAR_M]
        if not near:
            earlier = [pose for travelled, pose in recent if travelled <= now - PATH_M]
            return earlier[-1] if earlier else recent[0][1]
        turned = near[0][2]
        turns = sorted(math.remainder(pose[2] - turned, math.tau) for pose in near)
        middle = len(near) // 2
        return (
            sorted(pose[0] for pose in near)[middle],
            sorted(pose[1] for pose in near)[middle],
            turned + turns[middle],
        )


def _alignment(truth: Floats, estimate: Floats) -> Floats:
    """T_truth_map by one pose in both frames."""
    turn = truth[2] - estimate[2]
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = estimate[0], estimate[1]
    return truth[0] - cos * x + sin * y, truth[1] - sin * x - cos * y, turn


def _miss(truth: Floats, estimate: Floats, T_truth_map: Floats) -> tuple[float, float]:
    """How far an estimate is off [m, deg], given the frames' alignment."""
    cos, sin = math.cos(T_truth_map[2]), math.sin(T_truth_map[2])
    x, y = estimate[0], estimate[1]
    metres = math.hypot(T_truth_map[0] + cos * x - sin * y - truth[0], T_truth_map[1] + sin * x + cos * y - truth[1])
    return metres, abs(math.degrees(math.remainder(T_truth_map[2] + estimate[2] - truth[2], math.tau)))


class Spell(NamedTuple):
    """A time during which the estimate was lost, or had drifted."""

    start: float
    """Stamp [s]."""
    end: float | None
    """Stamp [s]; None = to the end of the run."""


def spells(steps: Columns, state: Literal["drifted", "lost"]) -> list[Spell]:
    """When the pose while driving was in a state, by the table of a run; empty where its truth is unknown."""
    if "true_x" not in steps:
        return []
    rows = updates(steps)
    stamps, poses = column(steps, "stamp")[rows], pose_columns(steps)[rows]
    truth = pose_columns(steps, "true_")[rows]
    known = np.isfinite(truth).all(axis=1)
    stamps, watch, found = stamps[known], LossWatch(), list[Spell]()
    for true_pose, pose in zip(truth[known].tolist(), poses[known].tolist(), strict=True):
        before, change = watch.state, watch.update(true_pose, pose)
        if change is None or watch.state == before:
            continue
        since = float(stamps[change.since])
        if before == state:
            found[-1] = Spell(found[-1].start, since)
        elif watch.state == state:
            found.append(Spell(since, None))
    return found
