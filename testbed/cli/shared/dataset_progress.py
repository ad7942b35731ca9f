# SPDX-License-Identifier: MIT
"""Progress display of a job that makes datasets: how many are done, simulated seconds per second, size, time left."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

from rich.console import Group
from rich.live import Live
from rich.progress_bar import ProgressBar

from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import console

REPORT_EVERY = 0.1
"""Without a terminal a line is printed each time this share of the datasets is done."""
MIN_REPORTED = 10
"""Smaller jobs print no lines without a terminal."""


class DatasetProgress:
    """A line and a bar."""

    def __init__(self, count: int) -> None:
        self._count, self._done = count, 0
        self._seconds = self._bytes = 0.0
        self._reported = 0.0
        self._last = self._stage = ""
        self._stage_began = 0.0
        self._begun = time.perf_counter()
        self._first: tuple[float, float] | None = None
        """Time and simulated time [s] when the first dataset was finished: how long the start takes says nothing of how
        long the others take."""

    def stage(self, text: str) -> None:
        """Name what is done now, until the next dataset is finished."""
        self._stage, self._stage_began = text, time.monotonic()
        AT_WORK.now_doing(text)
        if not console.is_terminal and self._count >= MIN_REPORTED:
            console.print(f"{text} …", soft_wrap=True)

    def done(self, name: str, seconds: float, size: int) -> None:
        """A dataset is finished: its name, simulated time [s] and size [bytes]."""
        self._done += 1
        self._seconds += seconds
        self._bytes += size
        self._last, self._stage = name, ""
        self._first = self._first or (time.monotonic(), self._seconds)
        AT_WORK.now_doing(self.line(), self._begun)  # of the whole, as the time left is
        share = self._done / self._count
        if not console.is_terminal and self._count >= MIN_REPORTED and share >= self._reported + REPORT_EVERY:
            self._reported = share
            console.print(self.line(), soft_wrap=True)

    def line(self) -> str:
        """The state of the job in one line."""
        stage = f"{self._stage} ({time.monotonic() - self._stage_began:.0f} s)" if self._stage else ""
        if not self._count:
            return stage
        parts = [f"{self._done} of {self._count} datasets"]
        if self._done:
            parts.append(f"{self._bytes / 1e6:.0f} MB")
        if stage:
            return ", ".join([*parts, stage])
        if self._first is not None and self._done > 1:
            elapsed = max(time.monotonic() - self._first[0], 1e-9)
            left = timedelta(seconds=round(elapsed * (self._count - self._done) / (self._done - 1)))
            parts += [f"{(self._seconds - self._first[1]) / elapsed:.0f} simulated s per s", f"{left} left"]
        return ", ".join([*parts, f"last finished: {self._last}"] if self._last else parts)

    def __rich__(self) -> Group:
        return Group(self.line(), ProgressBar(max(self._count, 1), self._done, width=60))


@contextmanager
def dataset_progress(count: int) -> Iterator[DatasetProgress]:
    """Show the progress while the block runs; if stderr is no terminal, print a line from time to time."""
    progress = DatasetProgress(count)
    if not console.is_terminal:
        yield progress
        return
    with Live(progress, console=console, transient=True, refresh_per_second=4):
        yield progress
