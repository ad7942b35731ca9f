# SPDX-License-Identifier: MIT
"""`testbed view`."""

from __future__ import annotations

from pathlib import Path

from testbed.cli.shared.console import console
from testbed.views import open_run


def view(run: Path, *, serve: bool = False) -> None:
    """Open the recording of a run in the Rerun viewer.

    Parameters
    ----------
    run
        Directory of a run.
    serve
        Serve the recording to a web browser on this machine instead of opening a window.
    """
    viewer = open_run(run, serve=serve)
    if viewer.address is not None:
        console.print(f"view: {viewer.address}", soft_wrap=True)
    viewer.wait()
