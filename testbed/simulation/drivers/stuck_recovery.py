# SPDX-License-Identifier: MIT
"""Noticing that a robot does not get on, and backing off."""

from __future__ import annotations

import math

_PROGRESS = 0.05
"""Motion that counts as progress [m]."""
_TURN_PROGRESS = 0.2
"""Turning that counts as progress [rad]."""
_SPEED, _TIME = -0.1, 2.0
"""Of backing off [m/s], [s]."""


class StuckRecovery:
    """Watches a robot that should be moving; where it has not for some time, drives it back for two seconds."""

    def __init__(self, patience: float) -> None:
        """patience: time without progress after which the robot counts as stuck [s]."""
        self._patience = patience
        self._since = 0.0
        self._anchor: tuple[float, float, float] | None = None  # pose at that time
        self._until = -math.inf
        self.count = 0
        """How often the robot had to back off."""

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float] | None:
        """Speed [m/s] and turn rate [rad/s] of backing off; None where the robot gets on by itself."""
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
        """The robot stood still until now [s] for a good reason."""
        self._since = stamp
