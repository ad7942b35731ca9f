# SPDX-License-Identifier: MIT
"""The command line, within the test's own process or in one of its own."""

import sys

import pytest

from testbed.cli import main

TESTBED = [sys.executable, "-c", "from testbed.cli import main; main()"]
"""How to start `testbed` in a process of its own."""
AT_A_TERMINAL = [
    sys.executable,
    "-c",
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from testbed.cli import main; main()",
]
"""The same, for tests of Ctrl-C: in the background of a shell, as these tests may run, programs ignore it."""


def without_waiting(errors: str) -> list[str]:
    """The lines of stderr without those that a busy machine adds while a command is silent."""
    return [line for line in errors.splitlines() if not line.endswith(" s so far")]


def call(*arguments: object) -> int:
    """Exit status of `testbed` with these arguments."""
    with pytest.raises(SystemExit) as end:
        main([str(argument) for argument in arguments])
    return end.value.code


def assert_refused(capsys, complaint: str, *arguments: object) -> None:
    """Exit status 2, one line on stderr that says `complaint`, nothing on stdout."""
    capsys.readouterr()
    assert call(*arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert complaint in captured.err
