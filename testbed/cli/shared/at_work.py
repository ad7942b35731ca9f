# SPDX-License-Identifier: MIT
"""No command is silent for long: while it writes nothing, a thread of its own says what is being done."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

SILENCE = 4.0
"""So long may a command write nothing [s]."""


class AtWork:
    """What a command is doing, and when it was last heard of."""

    def __init__(self) -> None:
        now = time.perf_counter()
        self._jobs, self._heard = [("starting", now)], now

    def heard(self) -> None:
        """Note that the command has just written something."""
        self._heard = time.perf_counter()

    @contextmanager
    def doing(self, job: str) -> Iterator[None]:
        """Name what the block does, such as `reading robot_bag`."""
        self._jobs.append((job, time.perf_counter()))
        try:
            yield
        finally:
            self._jobs.pop()

    def now_doing(self, job: str, since: float | None = None) -> None:
        """Name what is done from now on, until the block of `doing` ends that is open.

        since: when it began, of `time.perf_counter` [s]; None = now
        """
        self._jobs[-1] = job, time.perf_counter() if since is None else since

    @contextmanager
    def watched(self, say: Callable[[str], object], silence: float = SILENCE) -> Iterator[None]:
        """During the block, say every time that nothing was heard for `silence` [s] what is done, and since when."""
        ended = Event()

        def watch() -> None:
            while not ended.wait(max(self._heard + silence - time.perf_counter(), 0.1)):
                if time.perf_counter() >= self._heard + silence:
                    job, since = self._jobs[-1]
                    say(f"{job}: {time.perf_counter() - since:.0f} s so far\n")
                    self.heard()

        thread = Thread(target=watch, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


AT_WORK = AtWork()
"""That of this process."""


def say_on_stderr(text: str) -> None:
    """Write a line on the stderr of the moment."""
    sys.stderr.write(text)
    sys.stderr.flush()
