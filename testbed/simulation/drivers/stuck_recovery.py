# SPDX-License-Identifier: MIT
"""Detection of a robot that is stuck, and backing off."""

from __future__ import annotations

import math

_PROGRESS = 0.05
"""Motion that counts as progress [m]."""
_TURN_PROGRESS = 0.2
"""Turning that counts as progress [rad]."""
_SPEED, _TIME = -0.1, 2.0
"""Speed [m/s] and duration [s] of backing off."""


class StuckRecovery:
    """Drives a robot back for two seconds if it makes no progress."""

    def __init__(self, patience: float) -> None:
        """patience: the robot is stuck if it has made no progress for this time [s]"""
        self._patience = patience
        self._since = 0.0
        self._anchor: tuple[float, float, float] | None = None  # pose at that time
        self._until = -math.inf
        self.count = 0
        """Number of times that the robot backed off."""

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float] | None:
        """Return speed [m/s] and turn rate [rad/s] of backing off; None if the robot makes progress."""
        if stamp < self._until:
            return _SPEED, 0.0
        if self._anchor is None or self._gets_on(*self._anchor, x, y, theta):
            self._since, self._anchor = stamp, (x, y, theta)
        elif stamp - self._since > self._patience:
            self.count += 1
            self._until = self._since = stamp + _TIME
            return _SPEED, 0.0
        return None

    @staticmethod
    def _gets_on(x0: float, y0: float, theta0: float, x: float, y: float, theta: float) -> bool:
        turned = abs(math.remainder(theta - theta0, 2.0 * math.pi))
        return math.hypot(x - x0, y - y0) > _PROGRESS or turned > _TURN_PROGRESS

    def wait(self, stamp: float) -> None:
        """Do not count the time up to `stamp` [s] as lack of progress."""
        self._since = stamp
