# SPDX-License-Identifier: MIT
"""Detection of a robot that is stuck, and backing off."""

from __future__ import annotations

import math

import numpy as np

from testbed.simulation.drivers._pursuit_kernels import BACK_OFF_SPEED, BACKING_OFF, backs_off


class StuckRecovery:
    """Drives a robot back for two seconds if it makes no progress."""

    def __init__(self, patience: float) -> None:
        """patience: the robot is stuck if it has made no progress for this time [s]"""
        self._patience = patience
        self.state = np.zeros(BACKING_OFF)
        """State as `backs_off` takes it."""
        self.state[1:5] = -math.inf, math.nan, math.nan, math.nan

    @property
    def count(self) -> int:
        """Number of times that the robot backed off."""
        return int(self.state[5])

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float] | None:
        """Return speed [m/s] and turn rate [rad/s] of backing off; None if the robot makes progress."""
        return (BACK_OFF_SPEED, 0.0) if backs_off(self.state, stamp, (x, y, theta), self._patience) else None

    def wait(self, stamp: float) -> None:
        """Do not count the time up to `stamp` [s] as lack of progress."""
        self.state[0] = stamp
