# SPDX-License-Identifier: MIT
"""The command line `testbed`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import nullcontext
from io import TextIOWrapper

from testbed.cli.shared.at_work import AT_WORK, say_on_stderr
from testbed.cli.shared.status import INTERRUPTED
from testbed.run.interruption import signals_end_process, signals_interrupt


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: 0 success, 1 a limit is broken, 2 an error of usage or input, 130 interrupted.

    Errors of usage or input are one line on stderr; `TESTBED_DEBUG=1` shows the traceback. SIGTERM has the effect of
    Ctrl-C, also while the rest of the program is still being imported.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # an ASCII terminal must not end a run
    try:
        with signals_interrupt(), AT_WORK.watched(say_on_stderr) if arguments is None else nullcontext():
            from testbed.cli.shared.app import run_app

            AT_WORK.now_doing(f"testbed {next(iter(sys.argv[1:]), '')}".rstrip())
            status = run_app(arguments)
    except KeyboardInterrupt:
        sys.stderr.write("testbed: interrupted\n")
        status = INTERRUPTED
    if arguments is None:  # this process has nothing else to do
        signals_end_process(status)
    sys.exit(status)
