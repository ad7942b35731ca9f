# SPDX-License-Identifier: MIT
"""Stand-ins for what takes most of the time of a test that is about something else."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from testbed.sweep.execution.local_pool import Event
    from testbed.sweep.execution.worker_process import Limits
    from testbed.sweep.spec.cell import Cell


@contextmanager
def undrawn() -> Iterator[None]:
    """Reports are written without the pictures that matplotlib draws; `tests/eval/report` and `tests/testbed/views`
    look at those."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("eval.report.plots", "eval.survival.page"):
            patch.setattr(f"{module}.svg_uri", lambda figure: "data:image/svg+xml;base64,")
        moments = "testbed.views.rerun.moment_picture.MomentPictures"
        patch.setattr(f"{moments}.png", lambda self, time, compared_with=(): b"")
        patch.setattr(f"{moments}.side_by_side", lambda self, before, at: b"")
        patch.setattr("eval.sweep.report.DRAWINGS", ())
        yield


def computed_here(cells: Sequence[Cell], workers: int, limits: Limits) -> Iterator[Event]:
    """Compute the cells in this process: an executor that takes the place of `run_locally`."""
    from testbed.sweep.execution.local_pool import Finished, Started
    from testbed.sweep.execution.worker import _answer
    from testbed.sweep.result import CellResult

    for cell in cells:
        yield Started(cell)
        answer = _answer(cell)
        yield Finished(cell, CellResult(**answer["result"]) if "result" in answer else answer["failure"])
