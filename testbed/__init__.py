# SPDX-License-Identifier: MIT
"""Simulator, recorded logs, views and the command line, which connect the estimator (`slam`) to data and measures.

Importing it registers the environments `testbed/Drive-v0` and `testbed/Explore-v0` with gymnasium.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from testbed.registration import register_environments, when_imported

if TYPE_CHECKING:
    import os

    from testbed.library import ShownRun

when_imported("gymnasium", register_environments)


def show(run: str | os.PathLike[str], *, viewer: bool = True) -> ShownRun:
    """Show a run directory or recording in a notebook: outcome, map, paths and the viewer (docs/python.md)."""
    from testbed import library  # here, for a command to start at once

    return library.show(run, viewer=viewer)
