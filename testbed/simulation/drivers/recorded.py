# SPDX-License-Identifier: MIT
"""A driver that repeats recorded commands."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

from testbed.simulation.drivers.driver import Command


class RecordedDriver:
    """Gives each command at its recorded time, and ends one period after the last.

    The commands do not depend on the pose: a robot that meets a wall keeps pushing, see `Simulation.collided`. While
    someone stands in the robot's way it waits, and the commands of that time are skipped. In the same world, with the
    same robot and seed, a recorded drive is reproduced bit by bit.
    """

    stuck = False
    recoveries = 0

    def __init__(self, commands: Sequence[Command], period: float) -> None:
        """commands: at least one, in the order of their stamps; period: duration of the last one [s]"""
        self._commands = [(command.speed, command.turn_rate) for command in commands]
        self._stamps = [command.stamp - commands[0].stamp for command in commands]
        self._period = period
        self._done = 0.0

    @property
    def finished(self) -> bool:
        """Whether all commands were given."""
        return self._done > self._stamps[-1] + 0.5 * self._period

    @property
    def share(self) -> float:
        """Share of the recording that is done, 0 to 1."""
        return min(self._done / (self._stamps[-1] + self._period), 1.0)

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float]:
        """Return the command of the time `stamp` [s]; the pose is ignored."""
        self._done = stamp + self._period
        latest = bisect_right(self._stamps, stamp + 1e-6) - 1  # stamps in files are rounded
        return self._commands[latest]

    def wait(self, stamp: float) -> tuple[float, float]:
        """Return the command 0, 0 while the recording goes on."""
        self._done = stamp + self._period
        return 0.0, 0.0
