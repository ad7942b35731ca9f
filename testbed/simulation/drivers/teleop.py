# SPDX-License-Identifier: MIT
"""A driver that takes commands from the keyboard of the terminal."""

from __future__ import annotations

import os
import select
import sys
import termios
import time
import tty
from types import TracebackType

from testbed.presets import RobotPreset
from testbed.simulation.drivers.driver import DriverConfig

HELP = "arrows or w a s d: faster, slower, left, right; space: stop; q: end"

FORWARD, BACK, LEFT, RIGHT, STOP, END = "forward", "back", "left", "right", "stop", "end"
KEYS = {
    b"w": FORWARD, b"s": BACK, b"a": LEFT, b"d": RIGHT, b" ": STOP, b"q": END,
    b"\x1b[A": FORWARD, b"\x1b[B": BACK, b"\x1b[D": LEFT, b"\x1b[C": RIGHT,
    b"\x1bOA": FORWARD, b"\x1bOB": BACK, b"\x1bOD": LEFT, b"\x1bOC": RIGHT,
}  # fmt: skip
"""Bytes that a terminal sends for letters and for arrows in normal and application mode (ECMA-48, xterm)."""
STEPS = 5
"""Number of key presses from standstill to the largest speed."""


class TeleopError(ValueError):
    """Standard input is not a terminal; the message says what to do."""


class TeleopDriver:
    """Each key press changes speed or turn rate by a fifth of the largest; the simulation runs in real time.

    Use it as a context manager: inside it the terminal sends keys at once and does not echo them.
    """

    stuck = False
    recoveries = 0
    share = None

    def __init__(self, robot: RobotPreset, config: DriverConfig) -> None:
        """Raise `TeleopError` if standard input is not a terminal."""
        self._speed_step = min(config.speed, robot.max_speed) / STEPS
        self._turn_step = min(config.turn_rate, robot.max_turn_rate) / STEPS
        self._speed, self._turn = 0, 0
        self._pending = b""
        self._started: float | None = None
        self.finished = False
        """Whether the person has ended the drive."""
        if not sys.stdin.isatty():
            raise TeleopError("driving by keyboard needs a terminal as standard input, not a file or pipe")
        self._terminal = sys.stdin.fileno()

    def __enter__(self) -> TeleopDriver:
        self._settings = termios.tcgetattr(self._terminal)
        tty.setcbreak(self._terminal)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        termios.tcsetattr(self._terminal, termios.TCSADRAIN, self._settings)

    def command(self, stamp: float, x: float, y: float, theta: float) -> tuple[float, float]:
        """Return the command of the keys pressed so far, once the wall clock has reached the time `stamp` [s]."""
        self._keep_time(stamp)
        self._read_keys()
        return self._speed * self._speed_step, self._turn * self._turn_step

    def wait(self, stamp: float) -> tuple[float, float]:
        """Return the command 0, 0; the keys are read."""
        self.command(stamp, 0.0, 0.0, 0.0)
        return 0.0, 0.0

    def _keep_time(self, stamp: float) -> None:
        now = time.monotonic()
        if self._started is None:
            self._started = now - stamp
        behind = now - self._started - stamp
        if behind > 0.0:
            self._started += behind  # the filter was slower than real time: that time is not made up for
        else:
            time.sleep(-behind)

    def _read_keys(self) -> None:
        while select.select([self._terminal], [], [], 0.0)[0]:
            read = os.read(self._terminal, 1024)
            if not read:  # the terminal is gone
                self.finished = True
                return
            self._pending += read
        while self._pending:
            key = next((key for key in KEYS if self._pending.startswith(key)), None)
            if key is None and any(known.startswith(self._pending) for known in KEYS):
                return  # the rest of an arrow is still to come
            self._pending = self._pending[len(key or b"?") :]
            if key is not None:
                self._press(KEYS[key])

    def _press(self, what: str) -> None:
        change = {FORWARD: (1, 0), BACK: (-1, 0), LEFT: (0, 1), RIGHT: (0, -1)}.get(what, (0, 0))
        self._speed = min(max(self._speed + change[0], -STEPS), STEPS)
        self._turn = min(max(self._turn + change[1], -STEPS), STEPS)
        if what in (STOP, END):
            self._speed = self._turn = 0
        self.finished = self.finished or what == END
