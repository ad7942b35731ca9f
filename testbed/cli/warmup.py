# SPDX-License-Identifier: MIT
"""`testbed warmup`."""

from __future__ import annotations

from testbed.cli.shared.console import announce_compilation, console
from testbed.kernels import is_compiled


def warmup() -> None:
    """Compile the kernels now instead of in the first run, for instance in the build of a container image.

    The machine code is kept in `~/.cache/slam-testbed` (or `$TESTBED_CACHE`) until the kernels change.
    """
    if is_compiled():
        console.print("The kernels are compiled already.")
    announce_compilation()
