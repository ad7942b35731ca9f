# SPDX-License-Identifier: MIT
"""Time left of a set of jobs: begins with the expected times and follows what the jobs really take."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from testbed.sweep.execution.local_pool import Event, Started
from testbed.sweep.result import CellResult
from testbed.sweep.spec.cell import Cell

MAX_RISE = 1.2
"""A new estimate that is larger than what was shown is shown only if it is so many times as large."""
TRUSTED_SHARE = 0.2
"""Expected times are trusted as much as this share of all work, at least as one finished job of each worker."""
START_SECONDS = 5.0
"""Typical time in which a worker starts [s]; the first job of each seems to take so much longer."""
MAX_RUNNING_SHARE = 0.95
"""A job that runs counts as done by at most this share."""


class TimeLeft:
    """Adds up the expected times of the jobs that are left, scaled by how fast the jobs so far were.

    The time that is shown falls from second to second, also while jobs run. Where a new estimate is a little larger
    than what was shown the display stands still instead of rising.
    """

    def __init__(
        self,
        cells: Sequence[Cell],
        expected: Callable[[Cell], float],
        workers: int | None,
        *,
        is_in_seconds: bool,
    ) -> None:
        """expected: time of a job, in seconds or (not is_in_seconds) in a unit that the first job will show.

        workers: None if it is unknown how many jobs run at the same time, as on a cluster.
        """
        self._expected = {cell.key: expected(cell) for cell in cells}
        self._total = max(sum(self._expected.values()), 1e-9)
        self._workers = None if workers is None else max(min(workers, len(cells)), 1)
        self._began = time.monotonic()
        of_each_worker = self._total / max(len(cells), 1) * (self._workers or 1)
        self._weight = max(of_each_worker, TRUSTED_SHARE * self._total) if is_in_seconds else 0.0
        """The expected times are trusted as much as so much finished work."""
        self._started: dict[str, float] = {}
        self._done: set[str] = set()
        self._spent = 0.0
        self._shown: float | None = None

    def event(self, event: Event) -> None:
        """A job has started or is finished."""
        key = event.cell.key
        if isinstance(event, Started):
            self._started[key] = time.monotonic()
            return
        waited = time.monotonic() - self._started.pop(key, time.monotonic())
        own = event.outcome.timing.get("cell_s") if isinstance(event.outcome, CellResult) else None
        self._spent += waited if own is None else own  # without the start of the worker
        self._done.add(key)

    @property
    def share(self) -> float:
        """Share of the work that is done, 0 to 1."""
        return sum(self._expected[key] for key in self._done if key in self._expected) / self._total

    @property
    def share_with_running(self) -> float:
        """The same with what the running jobs have probably done."""
        scale, now = self._scale(), time.monotonic()
        if not scale:
            return self.share
        running = [
            min((now - started) / scale, MAX_RUNNING_SHARE * self._expected.get(key, 0.0))
            for key, started in self._started.items()
        ]
        return self.share + sum(running) / self._total

    @property
    def seconds_per_job(self) -> float:
        """Mean time of a job [s]; 0 if it is unknown."""
        return (self._scale() or 0.0) * self._total / max(len(self._expected), 1)

    def seconds(self, extra: float) -> float | None:
        """Time left [s] with `extra` for what follows the jobs; None if nothing is known yet."""
        scale, now = self._scale(), time.monotonic()
        if self._workers is None:
            return (now - self._began) * (1.0 - self.share) / self.share + extra if self.share else None
        if scale is None:
            return None
        left = 0.0
        for key, expected in self._expected.items():
            if key not in self._done:
                elapsed = now - self._started[key] if key in self._started else 0.0
                left += max(scale * expected - elapsed, (1.0 - MAX_RUNNING_SHARE) * scale * expected)
        estimate = left / self._workers + extra
        if self._shown is None or estimate < self._shown or estimate > MAX_RISE * self._shown:
            self._shown = estimate
        return self._shown

    def _scale(self) -> float | None:
        """How many times as long as expected the jobs take; jobs that run longer than expected count already."""
        now = time.monotonic()
        work, spent = self._weight, self._weight
        work += sum(self._expected.get(key, 0.0) for key in self._done)
        spent += self._spent
        if work <= 0.0:
            return None
        for key, started in self._started.items():
            expected = self._expected.get(key, 0.0)
            if now - started > spent / work * expected + START_SECONDS:
                work, spent = work + expected, spent + now - started
        return spent / work
