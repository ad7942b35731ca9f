# SPDX-License-Identifier: MIT
"""Commands that were given to a robot, out of a recorded log or a table `stamp,speed,turn_rate`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path

from eval.files.atomic_write import atomic_write
from testbed.formats import LogError, open_log
from testbed.formats.csv_table import read_table
from testbed.frame import Frame
from testbed.simulation.drivers.driver import Command

COLUMNS = ("stamp", "speed", "turn_rate")
"""First line of a table of commands."""


def read_commands(path: str | Path) -> list[Command]:
    """All commands of a table (CSV) or of any log that `open_log` reads, in the order of time; at least one.

    Raises LogError, naming the file and the line, where there is none, where a number is none or not finite, or where
    the stamps step backwards.
    """
    path = Path(path)
    if _is_table(path):
        numbered = list(_rows(path))
    else:
        numbered = list(enumerate(commands_of(open_log(path, scans_needed=False).frames)))
    if not numbered:
        raise LogError(f"{path}: no commands: expected a log with /cmd_vel, or a table {','.join(COLUMNS)}")
    for (_, before), (number, after) in pairwise(numbered):
        if after.stamp < before.stamp:
            raise LogError(f"{path}:{number}: stamp {after.stamp:g} after {before.stamp:g}, expected increasing stamps")
    return [command for _, command in numbered]


def commands_of(frames: Iterable[Frame]) -> list[Command]:
    """The commands of a recording, as far as they are known."""
    return [Command(frame.stamp, *frame.command) for frame in frames if frame.command is not None]


def write_commands(path: str | Path, commands: Iterable[Command]) -> None:
    """Write a table that `read_commands` reads back to the last digit; it appears whole or not at all."""
    rows = "".join(f"{stamp!r},{speed!r},{turn_rate!r}\n" for stamp, speed, turn_rate in commands)
    with atomic_write(path) as aside:
        aside.write_text(f"{','.join(COLUMNS)}\n{rows}", encoding="utf-8")


def _is_table(path: Path) -> bool:
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            start = file.read(100)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}") from None
    return start.lstrip(b"\xef\xbb\xbf").startswith(COLUMNS[0].encode() + b",")


def _rows(path: Path) -> Iterator[tuple[int, Command]]:
    """Rows of a table with the numbers of their lines."""
    for line, values in read_table(path, COLUMNS):
        if not all(map(math.isfinite, values)):
            raise LogError(f"{path}:{line}: expected finite numbers, got {','.join(map(str, values))[:80]}")
        yield line, Command(*values)
