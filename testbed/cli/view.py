# SPDX-License-Identifier: MIT
"""`testbed view`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from testbed.cli.console import console
from testbed.views import open_run


def view(run: Path, *, layout: Literal["overview", "particles"] = "overview", serve: bool = False) -> None:
    """Open the recording of a run in the Rerun viewer.

    Examples:

        testbed view runs/office-20250101-120000
        testbed view runs/office-20250101-120000 --layout particles

    Parameters
    ----------
    run
        Directory of a run.
    layout
        overview: map, trajectories, plots; particles: several particles' maps side by side.
    serve
        Serve it to a web browser on this machine instead of opening a window.
    """
    viewer = open_run(run, layout=layout, serve=serve)
    if viewer.address is not None:
        console.print(f"view: {viewer.address}")
    viewer.wait()
