# SPDX-License-Identifier: MIT
"""The command line `testbed`. Commands are imported when they are called, so that `testbed --help` answers at once."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Sequence
from importlib.metadata import version

from cyclopts import App, CycloptsError

from testbed.cli.config_file import apply_config_file
from testbed.cli.status import INTERRUPTED, USAGE_ERROR

app = App(
    name="testbed",
    help="A SLAM testbed: simulate a robot or read a log, map it with a particle filter, score the result.",
    help_epilogue="First steps: `testbed run office`, then open the report whose path it prints.",
    version=lambda: version("slam-testbed"),
    config=apply_config_file,
    help_format="markdown",
    suppress_keyboard_interrupt=False,
    result_action="return_value",
)
app.command("testbed.cli.run:run", name="run", help="Simulate a robot in a world, map it, score the result.")
app.command("testbed.cli.slam:slam", name="slam", help="Map a recorded log, and score it where truth is known.")
app.command("testbed.cli.score:score", name="score", help="Score the output of any SLAM system by the same measures.")
app.command("testbed.cli.report:report", name="report", help="Write the report of a run anew, or compare several runs.")
app.command("testbed.cli.view:view", name="view", help="Open a run in the Rerun viewer.")
app.command("testbed.cli.convert:convert", name="convert", help="Turn a recorded log into another format.")
app.command("testbed.cli.worlds:app", name="worlds", help="The catalogue of worlds.")
app.command("testbed.cli.warmup:warmup", name="warmup", help="Compile the kernels now instead of in the first run.")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: 0 well, 1 a gate failed, 2 the user can put it right, 130 interrupted.

    What the user can put right is one line on stderr; `TESTBED_DEBUG=1` shows where it came from.
    """
    try:
        status = app(arguments, exit_on_error=False, print_error=False)
    except KeyboardInterrupt:
        _complain("interrupted")
        status = INTERRUPTED
    except BrokenPipeError:  # the reader of our output, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 0
    except (CycloptsError, ValueError, OSError) as error:
        if os.environ.get("TESTBED_DEBUG"):
            raise
        _complain(_one_line(error))
        status = USAGE_ERROR
    sys.exit(status)


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        what = "no space left on the disk" if error.errno == errno.ENOSPC else error.strerror.lower()
        return f"{error.filename}: {what}" if error.filename else what
    return " ".join(str(error).split())


def _complain(text: str) -> None:
    sys.stderr.write(f"testbed: {text}\n")
