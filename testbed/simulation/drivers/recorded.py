# SPDX-License-Identifier: MIT
"""A driver that repeats recorded commands, wherever they lead."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

from testbed.simulation.drivers.driver import Command


class RecordedDriver:
    """Gives each command at its time, the first one at once, and ends one period after the last.

    Nobody steers: a robot that meets a wall pushes on, which `Simulation.collided` tells. While someone stands in the
    robot's way it waits, and what was recorded for that time is left out. In the same world, with the same robot and
    seed, a drive that was recorded comes out again bit by bit.
    """

    stuck = False
    recoveries = 0

    def __init__(self, commands: Sequence[Command], period: float) -> None:
        """commands: in the order of their stamps, at least one;  period: how long the last one is kept [s]."""
        self._commands = [(command.speed, command.turn_rate) for command in commands]
        self._stamps = [command.stamp - commands[0].stamp for command in commands]
        self._period = period
        self._done = 0.0

    @property
    def finished(self) -> bool:
        """All commands were given."""
        return self._done > self._stamps[-1] + 0.5 * self._period

    @property
    def share(self) -> float:
        """Share of the recording that is behind the robot, 0 to 1."""
        return min(self._done / (self._stamps[-1] + self._period), 1.0)

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float]:
        """The command of that time [s], whatever the pose."""
        self._done = stamp + self._period
        latest = bisect_right(self._stamps, stamp + 1e-6) - 1  # stamps in files are rounded
        return self._commands[latest]

    def wait(self, stamp: float) -> tuple[float, float]:
        """Standing still, while the recording goes on."""
        self._done = stamp + self._period
        return 0.0, 0.0
