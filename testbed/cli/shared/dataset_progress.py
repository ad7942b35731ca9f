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
        self._started = time.monotonic()
        self._reported = 0.0
        self._last = ""

    def done(self, name: str, seconds: float, size: int) -> None:
        """A dataset is finished: its name, simulated time [s] and size [bytes]."""
        self._done += 1
        self._seconds += seconds
        self._bytes += size
        self._last = name
        share = self._done / self._count
        if not console.is_terminal and self._count >= MIN_REPORTED and share >= self._reported + REPORT_EVERY:
            self._reported = share
            console.print(self.line())

    def line(self) -> str:
        """The state of the job in one line."""
        elapsed = max(time.monotonic() - self._started, 1e-9)
        if not self._done:
            return f"0 of {self._count} datasets"
        left = timedelta(seconds=round(elapsed * (self._count - self._done) / self._done))
        rate, size = self._seconds / elapsed, self._bytes / 1e6
        return f"{self._done} of {self._count} datasets, {rate:.0f} simulated s per s, {size:.0f} MB, {left} left"

    def __rich__(self) -> Group:
        return Group(f"{self.line()}  {self._last}", ProgressBar(self._count, self._done, width=60))


@contextmanager
def dataset_progress(count: int) -> Iterator[DatasetProgress]:
    """Show the progress while the block runs; if stderr is no terminal, print a line from time to time."""
    progress = DatasetProgress(count)
    if not console.is_terminal or not count:
        yield progress
        return
    with Live(progress, console=console, transient=True, refresh_per_second=4):
        yield progress
