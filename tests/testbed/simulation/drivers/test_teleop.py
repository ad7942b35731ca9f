# SPDX-License-Identifier: MIT
"""Driving by keyboard, with a pseudo terminal in place of a person."""

import os
import pty
import sys
import termios
import time
from contextlib import suppress

import pytest

from testbed.presets import load_robot
from testbed.simulation import DriverConfig, simulate
from testbed.simulation.drivers.teleop import TeleopDriver, TeleopError
from tests.testbed.simulation.small_worlds import perfect, room

ROBOT, CONFIG = load_robot("create3"), DriverConfig(speed=0.4, turn_rate=1.0)


@pytest.fixture
def keyboard(monkeypatch):
    """The end of a terminal that a person types at; standard input is the other one."""
    person, program = pty.openpty()
    with os.fdopen(program, "r") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        yield person
    os.close(person)


def press(keyboard: int, keys: bytes) -> None:
    os.write(keyboard, keys)
    time.sleep(0.02)  # the kernel hands it over


@pytest.mark.parametrize(
    ("keys", "command"),
    [
        (b"", (0.0, 0.0)),
        (b"w", (0.08, 0.0)),
        (b"www", (0.24, 0.0)),
        (b"wwwwwwwww", (0.4, 0.0)),
        (b"s", (-0.08, 0.0)),
        (b"wa", (0.08, 0.2)),
        (b"d", (0.0, -0.2)),
        (b"\x1b[A\x1b[A\x1b[D", (0.16, 0.2)),
        (b"\x1bOB\x1bOC", (-0.08, -0.2)),
        (b"wwaa ", (0.0, 0.0)),
        (b"x\x1b[5~\xc3\xa4w", (0.08, 0.0)),
    ],
)
def test_keys(keyboard, keys, command):
    with TeleopDriver(ROBOT, CONFIG) as driver:
        press(keyboard, keys)
        assert driver.command(0.0, 0.0, 0.0, 0.0) == pytest.approx(command)
        assert not driver.finished


def test_an_arrow_may_come_in_pieces(keyboard):
    with TeleopDriver(ROBOT, CONFIG) as driver:
        for piece, speed in ((b"\x1b", 0.0), (b"[", 0.0), (b"A", 0.08)):
            press(keyboard, piece)
            assert driver.command(0.0, 0.0, 0.0, 0.0)[0] == pytest.approx(speed)


def test_the_terminal_is_restored_and_ctrl_c_works(keyboard):
    before = termios.tcgetattr(sys.stdin)
    with suppress(RuntimeError), TeleopDriver(ROBOT, CONFIG):
        local = termios.tcgetattr(sys.stdin)[3]
        assert not local & (termios.ECHO | termios.ICANON)
        assert local & termios.ISIG
        raise RuntimeError
    assert termios.tcgetattr(sys.stdin) == before


def test_a_drive_runs_in_real_time_until_the_person_ends_it(keyboard):
    with TeleopDriver(ROBOT, CONFIG) as driver, simulate(room(), perfect(backend="fast"), driver) as simulation:
        press(keyboard, b"wwwww")
        started = time.monotonic()
        for frame in simulation:
            if frame.stamp > 0.8:
                press(keyboard, b"q")
        seconds = time.monotonic() - started
    assert simulation.finished
    assert simulation.time == pytest.approx(1.0, abs=0.2)
    assert seconds == pytest.approx(simulation.time, abs=0.3)
    assert frame.truth[0] > 0.05


def test_without_a_terminal_it_says_so(monkeypatch, tmp_path):
    (tmp_path / "keys").write_text("wwww")
    with (tmp_path / "keys").open() as file:
        monkeypatch.setattr(sys, "stdin", file)
        with pytest.raises(TeleopError, match="needs a terminal"):
            TeleopDriver(ROBOT, CONFIG)
