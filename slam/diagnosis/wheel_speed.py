# SPDX-License-Identifier: MIT
"""Times at which the wheels report a speed that the robot can hardly have had: it changes at once, and at once back.

A counter that stands still or counts backward for a while, on a robot that drives forward, leaves this trace in the
odometry alone. A robot that really stops needs time to stop, and to be as fast again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2

MAX_ACCELERATION = 1.0
"""Drives of indoor robots change their speed by no more than this [m/s^2]; those of the presets by 0.3 to 1.0."""
SAME_SPEED, SPEED_NOISE = 0.1, 0.03
"""Two speeds are the same if they differ by less than this share, or by less than this [m/s]."""
MAX_SECONDS = 20.0
"""A speed that lasts longer than this is the robot's [s]."""

Stage = Literal["steady", "changed", "back", "kept"]


class WheelNews(NamedTuple):
    """What the speed of the wheels says of the time since the last news."""

    stage: Stage = "steady"
    """changed: the speed has changed at once; back: it was so, and is as before now, again at once; kept: it was so,
    and stayed, or came back as a robot can; steady: none of these."""
    missing: float = 0.0
    """Way along the heading that the wheels would have counted in addition, had the speed not changed [m]."""


class WheelSpeed:
    """Follows the speed of the wheels over all scans, also those that a filter does not use."""

    def __init__(self) -> None:
        """Begin without a speed."""
        self._last: tuple[float, list[float]] | None = None  # stamp [s], odometry
        self._speeds: list[tuple[float, float]] = []  # of the last three intervals: along the heading [m/s], length [s]
        self._before: float | None = None  # speed before it changed [m/s]
        self._since = 0.0  # for how long it has been another one [s]
        self._missing = 0.0
        self._stage: Stage = "steady"

    def update(self, stamp: float, odometry: se2.Pose) -> None:
        """Take in the odometry (3,) at a scan, joined where it started again, and its time [s]."""
        last, self._last = self._last, (float(stamp), odometry.tolist())
        if last is None or stamp <= last[0]:
            return
        seconds = self._last[0] - last[0]
        x, y, heading = last[1]
        speed = ((odometry[0] - x) * math.cos(heading) + (odometry[1] - y) * math.sin(heading)) / seconds
        self._speeds = [*self._speeds[-2:], (float(speed), seconds)]
        if self._before is None:
            self._look_for_a_change()
        else:
            self._follow(self._before, *self._speeds[-1])

    @property
    def news(self) -> WheelNews:
        """What was seen since the last step."""
        return WheelNews(self._stage, self._missing)

    def begin_step(self) -> None:
        """The last scan was used: a new step begins."""
        self._missing, self._stage = 0.0, "steady" if self._before is None else "changed"

    @property
    def _at_once(self) -> bool:
        """Whether the mean speed of the last interval differs from one of the two before by more than a drive can."""
        if len(self._speeds) < 3:
            return False
        (first, first_s), (second, second_s), (now, now_s) = self._speeds
        near, far = 0.5 * (second_s + now_s), 0.5 * (first_s + now_s) + second_s  # between the intervals' middles
        return (
            abs(now - second) > MAX_ACCELERATION * near + SPEED_NOISE
            or abs(now - first) > MAX_ACCELERATION * far + SPEED_NOISE
        )

    def _look_for_a_change(self) -> None:
        """Note whether a robot that was driving forward is slower at once, or drives backward."""
        before = self._speeds[0][0]
        if not self._at_once or before < self._speeds[-1][0]:
            return
        self._before, self._stage = before, "changed"
        self._missing += sum((before - speed) * seconds for speed, seconds in self._speeds[1:])
        self._since = sum(seconds for _, seconds in self._speeds[1:])

    def _follow(self, before: float, speed: float, seconds: float) -> None:
        """Go on with a speed [m/s] that is another one than before, or find that it is no longer."""
        self._since += seconds
        self._missing += (before - speed) * seconds
        if abs(speed - before) < max(SAME_SPEED * abs(before), SPEED_NOISE):
            self._stage, self._before = "back" if self._at_once else "kept", None
        elif self._since > MAX_SECONDS:
            self._stage, self._before = "kept", None

    def state(self) -> dict[str, Any]:
        """Everything remembered, as plain values."""
        return {
            "last": self._last,
            "speeds": self._speeds,
            "before": self._before,
            "since": self._since,
            "missing": self._missing,
            "stage": self._stage,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._last = None if state["last"] is None else (float(state["last"][0]), list(state["last"][1]))
        self._speeds = [(float(speed), float(seconds)) for speed, seconds in state["speeds"]]
        self._before, self._since, self._missing = state["before"], state["since"], state["missing"]
        self._stage = state["stage"]


def wheel_news(stamps: NDArray[np.float64], odometry: se2.Pose, used: NDArray[np.intp]) -> list[WheelNews]:
    """What the speed of the wheels says at each used scan of the time since the one before.

    stamps (scans,) [s], odometry (scans, 3): of all scans, joined where it started again;  used: numbers of those used
    """
    wheels, found, first = WheelSpeed(), [], 0
    for last in used.tolist():
        for k in range(first, last + 1):
            wheels.update(float(stamps[k]), odometry[k])
        found.append(wheels.news)
        wheels.begin_step()
        first = last + 1
    return found
