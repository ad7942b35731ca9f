# SPDX-License-Identifier: MIT
"""Backing off of a robot that makes no progress."""

import math

from testbed.simulation.drivers.stuck_recovery import StuckRecovery


def test_backing_off_takes_patience_and_lasts_two_seconds():
    back_off = StuckRecovery(patience=5.0)
    steps = [back_off.command(0.05 * k, 1.0, 1.0, 0.1 * math.sin(k)) for k in range(240)]
    assert [step is not None for step in steps].index(True) == 101
    assert sum(step is not None for step in steps) == 40
    assert back_off.count == 1
    moving = StuckRecovery(patience=5.0)
    assert all(moving.command(0.05 * k, 0.02 * k, 0.0, 0.0) is None for k in range(400))
    turning = StuckRecovery(patience=5.0)
    assert all(turning.command(0.05 * k, 0.0, 0.0, 0.02 * k) is None for k in range(400))
